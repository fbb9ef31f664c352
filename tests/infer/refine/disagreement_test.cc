#include "infer/refine/disagreement.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "core/geometry/sensor_kind.h"
#include "infer/refine/residuals.h"
#include "infer/refine/terms.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::disagreement_test {
namespace {

using testing_infer::Observe;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

constexpr double kSigma = 0.002;  // m, of each observation
constexpr int kBox = 2;           // the one that stands elsewhere

/// One sensor that has seen, from where it is thought to be, the stack with a box out of its place.
struct OneBoxElsewhere {
  Structure structure = PaperStructure();
  SensorPoints points;
  Pose pose = RingPose(35);
  std::vector<FrameInput> frames{{testing_infer::Borrowed(points), pose}};
  JointProblem problem;
  std::vector<double> displaced;  // the boxes as they stand
  Solution solution;

  explicit OneBoxElsewhere(double bulge_sigma_m = 0)
      : problem(structure, frames, WithBulges(bulge_sigma_m)) {
    solution.state = NominalState(structure, {pose});
    solution.held = {0};
    displaced = solution.state.boxes[0];
    displaced[static_cast<std::size_t>(BuildModel::X(kBox))] = 0.006;
    displaced[static_cast<std::size_t>(BuildModel::Z(kBox))] = -0.004;
    FrameObservations observed =
        Observe(problem.model.Built({&solution.state.size, displaced.data()}), pose, 12);
    const auto n = static_cast<Eigen::Index>(observed.faces.size());
    observed.face_root = kSigma * Eigen::MatrixXd::Identity(n, n);
    observed.edge_root = Eigen::MatrixXd(0, 0);
    solution.observed = {observed};
  }
  static RefineOptions WithBulges(double sigma) {
    RefineOptions options;
    options.bulge_sigma_m = sigma;
    return options;
  }
  Disagreement Measure(const char* estimate) const {
    return MeasureDisagreement(problem, solution,
                               AskedFor(ParseEstimate(estimate), problem.priors, 1), 0);
  }
};

constexpr char kWithoutLens[] = "boxes,size,depth_gain,depth_offset";

TEST(MeasureDisagreement, IsWhatTheSensorsOwnLeastSquaresGainBeyondItsOwnErrors) {
  const OneBoxElsewhere scene;
  const FrameObservations& observed = scene.solution.observed[0];
  const ParameterLayout& layout = scene.problem.layout;
  const Eigen::VectorXd sigmas = layout.PriorSigmas(scene.problem.priors, {observed.noise.depth});
  // Residuals and priors in standard deviations, of steps in the pose's tangent space and in the
  // other parameters, but for the lens.
  const auto errors = [&](const Eigen::VectorXd& step) {
    State state = scene.solution.state;
    const Vector6d turn = step.head<6>();
    state.poses[0] = PoseBlock(PerturbLeft(turn, scene.pose));
    state.offsets[0] += step[layout.Offset(0)];
    state.gains[0] += step[layout.Gain(0)];
    for (int k = 0; k < kNuisances; ++k)
      state.nuisances[0][static_cast<std::size_t>(k)] += step[layout.Nuisance(0, k)];
    for (int k = 0; k < kFrameErrors; ++k)
      state.errors[0][static_cast<std::size_t>(k)] += step[layout.FrameErrors(0) + k];
    state.size += step[layout.Size()];
    for (std::size_t k = 0; k < state.boxes[0].size(); ++k)
      state.boxes[0][k] += step[layout.Boxes() + static_cast<Eigen::Index>(k)];
    Eigen::VectorXd r;
    Residuals(scene.problem.model, observed, state.Parameters(0), &r, nullptr);
    Eigen::VectorXd all(r.size() + layout.size());
    all << r / kSigma, (layout.Values(state)).cwiseQuotient(sigmas.unaryExpr([](double sigma) {
      return std::max(sigma, 1e-9);
    }));
    return all;
  };
  constexpr double kStep = 1e-5;
  const Eigen::VectorXd at = errors(Eigen::VectorXd::Zero(layout.size()));
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(at.size(), layout.size());
  for (Eigen::Index k = 0; k < layout.size(); ++k) {
    if (k >= layout.Lens(0) && k < layout.Size()) continue;
    const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(layout.size(), k);
    jacobian.col(k) = (errors(step) - errors(-step)) / (2 * kStep);
  }
  const auto after_best = [&at](const Eigen::MatrixXd& by) -> Eigen::VectorXd {
    return at - by * by.completeOrthogonalDecomposition().solve(at);
  };
  const Eigen::VectorXd left = after_best(jacobian);
  const auto rms = [&](const Eigen::VectorXd& of) {
    const auto n = static_cast<Eigen::Index>(observed.faces.size());
    return kSigma * std::sqrt(of.head(n).squaredNorm() / static_cast<double>(n));
  };
  const Disagreement disagreement = scene.Measure(kWithoutLens);
  const double gain = (at.squaredNorm() - left.squaredNorm()) / 2;
  ASSERT_GT(gain, 40);
  EXPECT_NEAR(disagreement.cost, gain, 0.01 * gain);
  EXPECT_NEAR(disagreement.rms_together, rms(at), 1e-6);
  EXPECT_NEAR(disagreement.rms_alone, rms(left), 0.02 * rms(left));
  EXPECT_TRUE(Disagrees(disagreement, 13));
}

// Boxes stand in their places; a side that bulges by 3 mm is none of the others' business.
TEST(MeasureDisagreement, IsNotWhatABulgeExplains) {
  const auto cost = [](double sigma) {
    OneBoxElsewhere scene(sigma);
    FrameObservations& observed = scene.solution.observed[0];
    const auto faces = observed.faces.size();
    observed = Observe(scene.structure, scene.pose, 12);
    const auto n = static_cast<Eigen::Index>(observed.faces.size());
    observed.face_root = kSigma * Eigen::MatrixXd::Identity(n, n);
    observed.edge_root = Eigen::MatrixXd(0, 0);
    EXPECT_NEAR(static_cast<double>(n), static_cast<double>(faces), 5);
    for (FaceObservation& face : observed.faces) {
      const Side& side = scene.structure.SideOfLabel(face.label);
      const double out = 0.003 * side.BulgeAt(scene.pose * face.p) * (face.label % 2 ? 1 : -1);
      face.p += out * scene.pose.linear().transpose() * side.normal;
    }
    const double flat = scene.Measure(kWithoutLens).cost;
    for (double& bulge : scene.solution.state.bulges[0]) bulge = 0.004;
    EXPECT_NEAR(scene.Measure(kWithoutLens).cost, flat, 1e-9) << "wherever the solution has them";
    return flat;
  };
  EXPECT_GT(cost(0), 2);
  EXPECT_LT(cost(0.002), 0.5 * cost(0));
}

TEST(MeasureDisagreement, WhatIsNotAskedForIsAsItIsInTheSolution) {
  OneBoxElsewhere scene;
  scene.solution.state.boxes[0] = scene.displaced;
  scene.solution.state.UpdateBuilt(scene.problem.model);
  // The boxes stand where the sensor saw them: where they are not to be moved, it has nothing to
  // gain, and the priors of their places are none of its business.
  const Disagreement held = scene.Measure("depth_gain,depth_offset");
  EXPECT_NEAR(held.cost, 0, 1e-3);
  EXPECT_NEAR(held.rms_alone, held.rms_together, 1e-5);
  EXPECT_GT(scene.Measure(kWithoutLens).cost, 0.1);
}

TEST(Disagrees, IsUnlikelyAndPlainToSeeOrVeryUnlikely) {
  // Of half a chi-square with 13 degrees of freedom, 0.1 % lie above 17.26 (tables: 34.528).
  EXPECT_NEAR(UnlikelyCost(13), 17.26, 0.15);
  EXPECT_NEAR(UnlikelyCost(4), 18.467 / 2, 0.15);
  Disagreement of;
  of.rms_alone = 0.004;
  of.rms_together = 0.0054;
  of.cost = 30;
  EXPECT_FALSE(Disagrees(of, 13)) << "one of many, and little worse";
  of.rms_together = 0.0056;
  EXPECT_TRUE(Disagrees(of, 13)) << "farther off than measurements are by themselves";
  EXPECT_FALSE(Disagrees(of, 61)) << "of so many boxes, as much is to be expected";
  of.cost = 16;
  EXPECT_FALSE(Disagrees(of, 13)) << "by chance";
  of.cost = 45;
  of.rms_together = of.rms_alone;
  EXPECT_TRUE(Disagrees(of, 13));
  EXPECT_FALSE(Disagrees(of, 0)) << "nothing in common";
}

/// Sensors that see the stack as it is described, and before them one that saw a box elsewhere.
struct OddOne {
  Structure structure = PaperStructure();
  SensorPoints points;
  std::vector<Pose> poses;
  std::vector<FrameInput> frames;
  RefineOptions options;
  std::unique_ptr<JointProblem> problem;
  Solution solution;
  FreeSet asked_for;

  /// `elsewhere`: m, the box's way along x, as the first sensor saw it.
  explicit OddOne(double elsewhere, const RefineOptions& with = {},
                  const std::vector<double>& azimuths_deg = {35, 70, 180})
      : options(with) {
    options.bulge_sigma_m = 0;
    for (const double azimuth : azimuths_deg) {
      poses.push_back(RingPose(azimuth));
      frames.push_back({testing_infer::Borrowed(points), poses.back()});
    }
    problem = std::make_unique<JointProblem>(structure, frames, options);
    asked_for = AskedFor(ParseEstimate(kWithoutLens), problem->priors, poses.size());
    solution.state = NominalState(structure, poses);
    solution.held.assign(poses.size(), 0);
    solution.free = asked_for;
    for (std::size_t i = 0; i < poses.size(); ++i)
      solution.observed.push_back(Saw(i, i == 0 ? elsewhere : 0));
  }
  FrameObservations Saw(std::size_t i, double elsewhere) const {
    std::vector<double> boxes = solution.state.boxes[0];
    boxes[static_cast<std::size_t>(BuildModel::X(kBox))] = elsewhere;
    FrameObservations observed =
        Observe(problem->model.Built({&solution.state.size, boxes.data()}), poses[i], 12);
    const auto n = static_cast<Eigen::Index>(observed.faces.size());
    observed.face_root = kSigma * Eigen::MatrixXd::Identity(n, n);
    observed.edge_root = Eigen::MatrixXd(0, 0);
    return observed;
  }
  double Contradiction(std::size_t a, std::size_t b) const {
    return MeasureContradiction(*problem, solution, asked_for, a, b);
  }

  /// Half the least sum of squares, in standard deviations, of what some sensors measured and of
  /// the priors, by derivatives taken numerically.
  double LeastCost(const std::vector<std::size_t>& sensors) const {
    const ParameterLayout& layout = problem->layout;
    const Eigen::VectorXd sigmas = PriorSigmas(*problem, solution.observed);
    const auto errors = [&](const Eigen::VectorXd& step) {
      State state = solution.state;
      for (const ParameterLayout::Block& block : layout.Blocks(&state)) {
        if (block.size != block.tangent_size) continue;
        for (int k = 0; k < block.size; ++k) block.values[k] += step[block.column + k];
      }
      Eigen::VectorXd all = layout.Values(state).cwiseQuotient(sigmas);
      for (const std::size_t i : sensors) {
        const Vector6d turn = step.segment<6>(layout.Pose(i));
        state.poses[i] = PoseBlock(PerturbLeft(turn, poses[i]));
        Eigen::VectorXd r;
        Residuals(problem->model, solution.observed[i], state.Parameters(i), &r, nullptr);
        all.conservativeResize(all.size() + r.size());
        all.tail(r.size()) = r / kSigma;
      }
      return all;
    };
    constexpr double kStep = 1e-5;
    const Eigen::VectorXd at = errors(Eigen::VectorXd::Zero(layout.size()));
    Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(at.size(), layout.size());
    for (Eigen::Index k = 0; k < layout.size(); ++k) {
      if (k >= layout.Lens(0) && k < layout.Size()) continue;
      const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(layout.size(), k);
      jacobian.col(k) = (errors(step) - errors(-step)) / (2 * kStep);
    }
    const Eigen::VectorXd best = -jacobian.completeOrthogonalDecomposition().solve(at);
    return 0.5 * (at + jacobian * best).squaredNorm();
  }
};

TEST(MeasureContradiction, IsWhatOneStackCostsMoreThanTwo) {
  const OddOne scene(0.012);
  const double expected = scene.LeastCost({0, 1}) - scene.LeastCost({0}) - scene.LeastCost({1});
  ASSERT_GT(expected, 10);
  EXPECT_NEAR(scene.Contradiction(0, 1), expected, 0.02 * expected);
  EXPECT_NEAR(scene.Contradiction(1, 0), expected, 0.02 * expected);
  EXPECT_NEAR(scene.Contradiction(1, 2), 0, 0.1);
}

TEST(SetAsideDisagreeing, NamesThoseThatShowIt) {
  OddOne scene(0.04);
  scene.solution.observed[0].noise.depth.smooth_m = 0.004;
  const Agreed agreed =
      SetAsideDisagreeing(*scene.problem, scene.asked_for, std::move(scene.solution));
  ASSERT_TRUE(agreed.of[0].has_value());
  EXPECT_EQ(agreed.solution.observed[0].noise.depth.smooth_m, 0.004)
      << "what is known of its noise stands";
  EXPECT_FALSE(agreed.of[1] || agreed.of[2]);
  ASSERT_FALSE(agreed.of[0]->contradicts.empty());
  EXPECT_EQ(agreed.of[0]->contradicts.front(), 1) << "the other side of the stack tells less";
  EXPECT_TRUE(Disagrees(agreed.measured[0], 13));
  EXPECT_LT(agreed.measured[1].cost, 1) << "in the solution without the odd one";
}

TEST(SetAsideDisagreeing, AsksWhetherItWasOneStackAlsoWhereBoxesAreHeld) {
  for (const char* estimate : {"none", "boxes,depth_offset", "size"}) {
    OddOne scene(0.04);
    const EstimateSet asked = ParseEstimate(estimate);
    const FreeSet asked_for = AskedFor(asked, scene.problem->priors, 3);
    scene.solution.free = asked_for;
    const Agreed agreed = SetAsideDisagreeing(*scene.problem, asked_for, std::move(scene.solution));
    EXPECT_TRUE(agreed.of[0].has_value()) << estimate;
    EXPECT_FALSE(agreed.of[1] || agreed.of[2]) << estimate;
    // What is not to be estimated is where the structure has it.
    if (!asked.size) {
      EXPECT_EQ(agreed.solution.state.size, 0) << estimate;
    }
    if (asked.boxes) continue;
    EXPECT_EQ(agreed.solution.state.boxes[0], std::vector<double>(12, 0)) << estimate;
  }
}

TEST(SetAsideDisagreeing, WhatIsKnownExactlyIsNoneOfTheSensors) {
  RefineOptions exact;
  exact.box_sigma_m = exact.size_sigma_percent = 0;
  OddOne scene(0.04, exact);
  const Agreed agreed =
      SetAsideDisagreeing(*scene.problem, scene.asked_for, std::move(scene.solution));
  EXPECT_FALSE(agreed.of[0] || agreed.of[1] || agreed.of[2]);
}

TEST(SetAsideDisagreeing, AsksAboutTheBoxesAlsoWhereTheSizeIsKnownExactly) {
  RefineOptions known_size;
  known_size.size_sigma_percent = 0;
  OddOne scene(0.04, known_size);
  const Agreed agreed =
      SetAsideDisagreeing(*scene.problem, scene.asked_for, std::move(scene.solution));
  EXPECT_TRUE(agreed.of[0].has_value());
  EXPECT_FALSE(agreed.of[1] || agreed.of[2]);
}

TEST(SetAsideDisagreeing, KeepsAsideWhatWasAsideEarlier) {
  const auto aside = [](std::array<bool, 3> earlier) {
    OddOne scene(0.04);
    for (std::size_t i = 0; i < 3; ++i) scene.frames[i].aside = earlier[i];
    scene.problem = std::make_unique<JointProblem>(scene.structure, scene.frames, scene.options);
    const Agreed agreed =
        SetAsideDisagreeing(*scene.problem, scene.asked_for, std::move(scene.solution));
    return std::array<bool, 3>{agreed.of[0].has_value(), agreed.of[1].has_value(),
                               agreed.of[2].has_value()};
  };
  EXPECT_EQ(aside({false, false, false}), (std::array<bool, 3>{false, false, false}));
  EXPECT_EQ(aside({false, false, true}), (std::array<bool, 3>{false, false, true}));
}

TEST(SetAsideDisagreeing, OfTwoSensorsNeitherIsWrongHoweverManyFramesTheyHave) {
  OddOne scene(0.04);
  for (std::size_t i = 0; i < 3; ++i) scene.frames[i].sensor = i == 0 ? 0 : 1;
  scene.problem = std::make_unique<JointProblem>(scene.structure, scene.frames, scene.options);
  scene.solution.state.frame_of = scene.problem->frame_of;
  const Agreed agreed =
      SetAsideDisagreeing(*scene.problem, scene.asked_for, std::move(scene.solution));
  EXPECT_FALSE(agreed.of[0] || agreed.of[1] || agreed.of[2]);
}

TEST(SetAsideDisagreeing, OneThatCannotBeSolvedAloneDoesNotHideAnother) {
  OddOne scene(0.08, {}, {35, 70, 180, 250, 310});
  scene.solution.observed[1] = scene.Saw(1, -0.04);
  // Points whose errors are no numbers.
  SensorPoints spoilt;
  scene.frames[0].noise = scene.solution.observed[0].noise;
  scene.frames[0].noise->depth.smooth_m = std::nan("");
  const Side& side = scene.structure.SideOfLabel(1);
  for (const double along : {-0.01, 0.0, 0.01}) {
    SidePoint point;
    point.p = scene.poses[0].inverse() * Eigen::Vector3d(side.centre + along * side.axis_u);
    point.label = 1;
    spoilt.side_points.push_back(point);
  }
  scene.frames[0].points = testing_infer::Borrowed(spoilt);
  const Agreed agreed =
      SetAsideDisagreeing(*scene.problem, scene.asked_for, std::move(scene.solution));
  EXPECT_FALSE(agreed.of[0].has_value());
  EXPECT_TRUE(agreed.of[1].has_value());
}

TEST(MeasureContradiction, IsNoneWhereNumbersFail) {
  OddOne scene(0.012);
  FrameObservations& observed = scene.solution.observed[1];
  observed.face_root *= std::nan("");
  EXPECT_EQ(scene.Contradiction(0, 1), 0);
  // Finite, but of no use: measurements that are more exact than numbers are, by a little and by so
  // much that their squares are no numbers.
  const auto n = static_cast<Eigen::Index>(observed.faces.size());
  for (const double sigma : {1e-12, 1e-160}) {
    observed.face_root = sigma * Eigen::MatrixXd::Identity(n, n);
    EXPECT_EQ(scene.Contradiction(0, 1), 0) << sigma;
  }
}

TEST(MeasureDisagreement, IsNoneWhereNumbersFail) {
  OneBoxElsewhere scene;
  Eigen::MatrixXd& root = scene.solution.observed[0].face_root;
  for (const double sigma : {std::nan(""), 1e-12}) {
    root = sigma * Eigen::MatrixXd::Identity(root.rows(), root.cols());
    EXPECT_EQ(scene.Measure(kWithoutLens).cost, 0) << sigma;
  }
}

TEST(MeasureDisagreement, WithoutFacesThereIsNone) {
  OneBoxElsewhere scene;
  scene.solution.observed[0].faces.clear();
  scene.solution.observed[0].face_root = Eigen::MatrixXd(0, 0);
  EXPECT_EQ(scene.Measure(kWithoutLens).cost, 0);
}

}  // namespace
}  // namespace volalign::refine_internal::disagreement_test

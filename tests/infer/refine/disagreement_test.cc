#include "infer/refine/disagreement.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "infer/refine/fine_problem.h"
#include "infer/refine/residuals.h"
#include "tests/infer/refine/points_and_evidence.h"

namespace volalign::refine_internal {
namespace {

using testing_infer::Observe;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

constexpr double kSigma = 0.002;  // m, of each observation
constexpr int kBox = 2;           // the one that stands elsewhere

/// One sensor that has seen, from where it is thought to be, the stack with a box out of its place.
struct OneBoxElsewhere {
  Structure structure = PaperStructure();
  SensorPoints points{{}, {}, {}};
  Pose pose = RingPose(35);
  std::vector<RefineFrame> frames{{&points, pose, pose, pose, true}};
  RefineOptions options;
  JointProblem problem;
  std::vector<double> displaced;  // the boxes as they stand
  Solution solution;

  OneBoxElsewhere() : problem(structure, frames, options) {
    solution.state = NominalState(structure, {pose});
    solution.kept_initial = {0};
    displaced = solution.state.boxes[0];
    displaced[static_cast<std::size_t>(BuildModel::X(kBox))] = 0.006;
    displaced[static_cast<std::size_t>(BuildModel::Z(kBox))] = -0.004;
    SensorEvidence evidence =
        Observe(problem.model.Built({&solution.state.size, displaced.data()}), pose, 12);
    const auto n = static_cast<Eigen::Index>(evidence.faces.size());
    evidence.face_root = kSigma * Eigen::MatrixXd::Identity(n, n);
    evidence.edge_root = Eigen::MatrixXd(0, 0);
    solution.evidence = {evidence};
  }
  Disagreement Measure(const char* estimate) const {
    return MeasureDisagreement(problem, solution,
                               AskedFor(ParseEstimate(estimate), problem.priors, 1, 4), 0);
  }
};

constexpr char kWithoutLens[] = "boxes,size,depth_gain,depth_offset";

TEST(MeasureDisagreement, IsWhatTheSensorsOwnLeastSquaresGain) {
  const OneBoxElsewhere scene;
  const SensorEvidence& evidence = scene.solution.evidence[0];
  const ParameterLayout& layout = scene.problem.layout;
  const Eigen::VectorXd sigmas =
      layout.PriorSigmas(scene.problem.priors, {evidence.noise.multipath});
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
    state.size += step[layout.Size()];
    for (std::size_t k = 0; k < state.boxes[0].size(); ++k)
      state.boxes[0][k] += step[layout.Boxes() + static_cast<Eigen::Index>(k)];
    Eigen::VectorXd r;
    Residuals(scene.problem.model, evidence, state.Parameters(0), &r, nullptr);
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
  const Eigen::VectorXd best = -jacobian.completeOrthogonalDecomposition().solve(at);
  const Eigen::VectorXd left = at + jacobian * best;
  const auto rms = [&](const Eigen::VectorXd& of) {
    const auto n = static_cast<Eigen::Index>(evidence.faces.size());
    return kSigma * std::sqrt(of.head(n).squaredNorm() / static_cast<double>(n));
  };
  const Disagreement disagreement = scene.Measure(kWithoutLens);
  const double gain = (at.squaredNorm() - left.squaredNorm()) / 2;
  ASSERT_GT(gain, 40);
  EXPECT_NEAR(disagreement.cost, gain, 0.01 * gain);
  EXPECT_NEAR(disagreement.rms_together, rms(at), 1e-6);
  EXPECT_NEAR(disagreement.rms_alone, rms(left), 0.02 * rms(left));
  EXPECT_TRUE(Disagrees(disagreement, 4));
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
  EXPECT_FALSE(Disagrees(of, 4)) << "one of many, and little worse";
  of.rms_together = 0.0056;
  EXPECT_TRUE(Disagrees(of, 4)) << "farther off than measurements are by themselves";
  EXPECT_FALSE(Disagrees(of, 20)) << "of so many boxes, as much is to be expected";
  of.cost = 16;
  EXPECT_FALSE(Disagrees(of, 4)) << "by chance";
  of.cost = 45;
  of.rms_together = of.rms_alone;
  EXPECT_TRUE(Disagrees(of, 4));
}

/// Two sensors that see the stack as it is described, and one that saw a box elsewhere.
struct OddOne {
  Structure structure = PaperStructure();
  SensorPoints points{{}, {}, {}};
  std::vector<Pose> poses{RingPose(35), RingPose(70), RingPose(180)};
  std::vector<RefineFrame> frames;
  RefineOptions options;
  std::unique_ptr<JointProblem> problem;
  Solution solution;
  FreeSet asked_for;

  /// `elsewhere`: m, the box's way along x, as the first sensor saw it.
  explicit OddOne(double elsewhere) {
    for (const Pose& pose : poses) frames.push_back({&points, pose, pose, pose, true});
    problem = std::make_unique<JointProblem>(structure, frames, options);
    asked_for = AskedFor(ParseEstimate(kWithoutLens), problem->priors, 3, 4);
    solution.state = NominalState(structure, poses);
    solution.kept_initial = {0, 0, 0};
    solution.free = asked_for;
    for (std::size_t i = 0; i < 3; ++i) {
      std::vector<double> boxes = solution.state.boxes[0];
      if (i == 0) boxes[static_cast<std::size_t>(BuildModel::X(kBox))] = elsewhere;
      SensorEvidence evidence =
          Observe(problem->model.Built({&solution.state.size, boxes.data()}), poses[i], 12);
      const auto n = static_cast<Eigen::Index>(evidence.faces.size());
      evidence.face_root = kSigma * Eigen::MatrixXd::Identity(n, n);
      evidence.edge_root = Eigen::MatrixXd(0, 0);
      solution.evidence.push_back(evidence);
    }
  }
  double Contradiction(std::size_t a, std::size_t b) const {
    return MeasureContradiction(*problem, solution, asked_for, a, b);
  }

  /// Half the least sum of squares, in standard deviations, of what some sensors measured and of
  /// the priors, by derivatives taken numerically.
  double LeastCost(const std::vector<std::size_t>& sensors) const {
    const ParameterLayout& layout = problem->layout;
    const Eigen::VectorXd sigmas = PriorSigmas(*problem, solution.evidence);
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
        Residuals(problem->model, solution.evidence[i], state.Parameters(i), &r, nullptr);
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
  const Agreed agreed =
      SetAsideDisagreeing(*scene.problem, scene.asked_for, std::move(scene.solution));
  ASSERT_TRUE(agreed.of[0].has_value());
  EXPECT_FALSE(agreed.of[1] || agreed.of[2]);
  ASSERT_FALSE(agreed.of[0]->contradicts.empty());
  EXPECT_EQ(agreed.of[0]->contradicts.front(), 1) << "the other side of the stack tells less";
  EXPECT_TRUE(Disagrees(agreed.measured[0], 4));
  EXPECT_LT(agreed.measured[1].cost, 1) << "in the solution without the odd one";
}

TEST(MeasureDisagreement, WithoutFacesThereIsNone) {
  OneBoxElsewhere scene;
  scene.solution.evidence[0].faces.clear();
  scene.solution.evidence[0].face_root = Eigen::MatrixXd(0, 0);
  EXPECT_EQ(scene.Measure(kWithoutLens).cost, 0);
}

}  // namespace
}  // namespace volalign::refine_internal

#include "infer/refine/parameters.h"

#include <ceres/crs_matrix.h>
#include <ceres/problem.h>
#include <gtest/gtest.h>

#include <functional>
#include <numeric>
#include <string>
#include <vector>

#include "infer/refine/gauge.h"
#include "infer/refine/pair_overlap.h"
#include "infer/refine/problem.h"
#include "infer/refine/solution.h"
#include "infer/refine/terms.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::parameters_test {
namespace {

using namespace testing_infer;

/// A parameter by its own name, and where the layout says its column is.
struct Named {
  std::string name;
  Eigen::Index column;
  std::function<void(State*, double)> move;
};

/// Moves a pose by a step of its tangent space.
void MovePose(int k, double step, PoseBlock* pose) {
  PoseBlock moved(PerturbLeft(step * Vector6d::Unit(k), pose->ToPose()));
  // Of the two quaternions of a rotation, the nearer.
  Eigen::Map<Eigen::Vector4d> q(moved.values);
  if (q.dot(Eigen::Map<Eigen::Vector4d>(pose->values)) < 0) q = -q;
  *pose = moved;
}

std::vector<Named> AllParameters(const ParameterLayout& layout) {
  std::vector<Named> all;
  const auto add = [&](const std::string& name, Eigen::Index column,
                       const std::function<double&(State*)>& of) {
    all.push_back({name, column, [of](State* s, double h) { of(s) += h; }});
  };
  const auto add_pose = [&](const std::string& name, Eigen::Index column,
                            const std::function<PoseBlock&(State*)>& of) {
    for (int k = 0; k < 6; ++k)
      all.push_back({name + " " + std::to_string(k), column + k,
                     [of, k](State* s, double h) { MovePose(k, h, &of(s)); }});
  };
  for (std::size_t i = 0; i < layout.frames(); ++i) {
    const std::string frame = " of frame " + std::to_string(i);
    add_pose("pose" + frame, layout.Pose(i), [i](State* s) -> PoseBlock& { return s->poses[i]; });
    add("offset" + frame, layout.Offset(i), [i](State* s) -> double& { return s->offsets[i]; });
  }
  for (std::size_t capture = 1; capture < layout.captures(); ++capture)
    add_pose("placement", layout.Placement(capture),
             [capture](State* s) -> PoseBlock& { return s->placements[capture]; });
  for (std::size_t i = 0; i < layout.sensors(); ++i) {
    for (int k = 0; k < kSensorErrors; ++k)
      add("error" + std::to_string(k) + " of sensor " + std::to_string(i),
          layout.ErrorsOfSensor(i) + k, [i, k](State* s) -> double& { return s->errors[i][k]; });
  }
  for (std::size_t lens = 0; lens < layout.lenses(); ++lens) {
    for (int k = 0; k < kLensParameters; ++k)
      add("lens" + std::to_string(lens) + "," + std::to_string(k), layout.Lens(lens) + k,
          [lens, k](State* s) -> double& { return s->lenses[lens][k]; });
  }
  add("size", layout.Size(), [](State* s) -> double& { return s->size; });
  for (std::size_t capture = 0; capture < layout.captures(); ++capture) {
    for (int b = 0; b < static_cast<int>(layout.boxes()); ++b) {
      int k = 0;
      for (const int at : {BuildModel::X(b), BuildModel::Z(b), BuildModel::Yaw(b)})
        add("box " + std::to_string(b), layout.Boxes(capture) + Eigen::Index{3} * b + k++,
            [capture, at](State* s) -> double& {
              return s->boxes[capture][static_cast<std::size_t>(at)];
            });
    }
    for (int label = 1; label <= 5 * static_cast<int>(layout.boxes()); ++label) {
      const int at = BuildModel::Bulge(label);
      add("side " + std::to_string(label), layout.Bulges(capture) + at,
          [capture, at](State* s) -> double& {
            return s->bulges[capture][static_cast<std::size_t>(at)];
          });
    }
  }
  add_pose("world", layout.World(), [](State* s) -> PoseBlock& { return s->world; });
  add("scale of the world", layout.WorldScale(),
      [](State* s) -> double& { return s->world_scale; });
  return all;
}

/// Compares derivatives of all terms with differences, for sensors with so many lenses.
void ExpectColumnsOfTheJacobian(int lens_count) {
  // The stack stands elsewhere in the second capture, which has a frame of the first sensor.
  Rig rig{PaperStructure(), {}, {}};
  const Pose placement = MakePose({0, 0.7, 0}, {0.4, 0, -0.2});
  rig.Add("A", RingPose(40));
  rig.Add("B", RingPose(100));
  rig.Add("A", placement.inverse() * RingPose(40));
  std::vector<SensorPoints> points = PointsOf(rig);
  std::vector<FrameInput> frames;
  std::vector<SensorLens> lenses(static_cast<std::size_t>(lens_count));
  for (std::size_t i = 0; i < 3; ++i) {
    const Pose start = Displaced(*rig.frames[i].ground_truth, 0.01, 0.5, i);
    const int sensor = i == 1 ? 1 : 0;
    points[i].intrinsics = rig.frames[i].intrinsics;
    frames.push_back({Borrowed(points[i]), start, sensor % lens_count, sensor, i == 2 ? 1 : 0});
  }
  for (std::size_t i = 0; i < 2; ++i)
    frames[i].prior =
        PosePrior{Displaced(frames[i].start, 0.1, 3, 7), PriorWorld::kScaleFree, 0.05, 3};
  for (SensorLens& lens : lenses) lens.prior_sigmas = Eigen::Vector3d(0.01, 0.1, 0.2);
  const RefineOptions options;
  const JointProblem problem(rig.structure, frames, options, lenses, 2);
  State state = NominalState(rig.structure, {frames[0].start, frames[1].start, frames[2].start},
                             lenses, problem.frame_of, {Pose::Identity(), placement});
  const FreeSet everything = AskedFor(ParseEstimate("auto"), problem.priors, 3, lenses);
  const std::vector<FrameObservations> observed =
      GatherObservations(problem, state, everything, {});
  const ParameterLayout& layout = problem.layout;
  const std::vector<char> none(static_cast<std::size_t>(layout.size()), 0);
  const std::vector<PairOverlap> overlaps = FindOverlaps(problem, observed, {0, 0, 0}, state);
  ASSERT_GT(overlaps.at(0).of_a.size(), 100u);
  for (const Named& parameter : AllParameters(layout))
    parameter.move(&state, 0.001 * static_cast<double>(parameter.column % 5 - 2));
  const CeresProblem ceres =
      BuildCeresProblem(problem, observed, overlaps, {0, 0, 0}, none, &state);

  ceres::Problem::EvaluateOptions evaluation;
  for (const ParameterLayout::Block& block : layout.Blocks(&state))
    evaluation.parameter_blocks.push_back(block.values);
  ceres::CRSMatrix sparse;
  std::vector<double> ignored;
  ASSERT_TRUE(ceres.problem->Evaluate(evaluation, nullptr, &ignored, nullptr, &sparse));
  ASSERT_EQ(sparse.num_cols, layout.size());
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(sparse.num_rows, sparse.num_cols);
  for (int row = 0; row < sparse.num_rows; ++row) {
    for (int k = sparse.rows[static_cast<std::size_t>(row)];
         k < sparse.rows[static_cast<std::size_t>(row) + 1]; ++k) {
      const auto at = static_cast<std::size_t>(k);
      jacobian(row, sparse.cols[at]) = sparse.values[at];
    }
  }
  const auto residuals_after = [&](const Named& parameter, double step) {
    parameter.move(&state, step);  // in the memory that Ceres refers to
    std::vector<double> residuals;
    EXPECT_TRUE(ceres.problem->Evaluate(evaluation, nullptr, &residuals, nullptr, nullptr));
    parameter.move(&state, -step);
    return Eigen::VectorXd(
        Eigen::Map<Eigen::VectorXd>(residuals.data(), static_cast<Eigen::Index>(residuals.size())));
  };
  std::vector<int> named(static_cast<std::size_t>(layout.size()), 0);
  constexpr double kStep = 1e-6;
  for (const Named& parameter : AllParameters(layout)) {
    ++named[static_cast<std::size_t>(parameter.column)];
    const Eigen::VectorXd numeric =
        (residuals_after(parameter, kStep) - residuals_after(parameter, -kStep)) / (2 * kStep);
    const double scale = numeric.cwiseAbs().maxCoeff();
    ASSERT_GT(scale, 0) << parameter.name;
    EXPECT_LT((jacobian.col(parameter.column) - numeric).cwiseAbs().maxCoeff(), 1e-4 * scale)
        << parameter.name;
  }
  for (const int times : named) EXPECT_EQ(times, 1) << "every column has one name";
}

TEST(ParameterLayout, ColumnsAreThoseOfTheJacobianThatCeresEvaluates) {
  for (const int lens_count : {1, 2}) ExpectColumnsOfTheJacobian(lens_count);
}

TEST(ParameterLayout, PriorsStandAtTheirParameters) {
  const ParameterLayout layout = LayoutOf(2, 3);
  SensorLens lens;
  lens.prior_sigmas = Eigen::Vector3d(0.01, 0.2, 0.1);
  lens.own_focal_sigma = 0.0015;
  DepthErrorModel seam, none;
  seam.seam_m = 0.001;
  seam.tilt_m = 0.003;
  seam.bounce_m = 0.004;
  const Eigen::VectorXd sigmas = layout.PriorSigmas(SomePriors(), {seam, none}, {lens});
  ASSERT_EQ(sigmas.size(), 2 * (6 + 1 + kSensorErrors) + 3 + 1 + (3 + 5) * 3 + 7);
  EXPECT_EQ(sigmas.segment<kLensParameters>(layout.Lens(0)), lens.prior_sigmas);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(sigmas[layout.Pose(i) + 5], 1);
    EXPECT_EQ(sigmas[layout.Offset(i)], 0.007);
    EXPECT_EQ(sigmas[layout.Error(i, kGain)], 0.003);
    EXPECT_EQ(sigmas[layout.Error(i, kFocal)], 0.0015);
    EXPECT_EQ(sigmas[layout.Error(i, kMultipath)], i == 0 ? 0.001 : 1e-6) << "none is not 0";
    EXPECT_EQ(sigmas[layout.Error(i, kEdgeShift) + 1], 0.7);
    EXPECT_EQ(sigmas[layout.ErrorsOfSensor(i) + kTiltColumns], i == 0 ? 0.003 : 1e-6);
    EXPECT_NEAR(sigmas[layout.ErrorsOfSensor(i) + kDiffuseMultipath], i == 0 ? 0.00462 : 1e-6, 1e-5)
        << "root mean square of what lies evenly within twice the mean";
  }
  EXPECT_EQ(sigmas[layout.Size()], 0.01);
  for (Eigen::Index b = 0; b < 3; ++b) {
    EXPECT_EQ(sigmas[layout.Boxes() + 3 * b], 0.004);
    EXPECT_EQ(sigmas[layout.Boxes() + 3 * b + 1], 0.004);
    EXPECT_EQ(sigmas[layout.Boxes() + 3 * b + 2], 0.009);
  }
  EXPECT_TRUE((sigmas.segment(layout.Bulges(0), 5 * 3).array() == 0.002).all());
  EXPECT_TRUE((sigmas.tail(7).array() == 1).all()) << "the world of pose priors";
}

TEST(ParameterLayout, WhatIsNotFreeIsConstant) {
  const ParameterLayout layout = LayoutOf(2, 4);
  FreeSet free = AskedFor(ParseEstimate("auto"), SomePriors(), 2);
  EXPECT_TRUE(free.boxes);
  free.boxes = free.gain = false;
  const auto fixed = [&](const std::vector<char>& constant) {
    return std::accumulate(constant.begin(), constant.end(), 0);
  };
  constexpr int kKnownLens = kLensParameters + 2;  // and the sensors' own focal lengths
  EXPECT_EQ(fixed(layout.Constant(free)), 12 + 2 + kKnownLens);
  const std::vector<char> without_0 = layout.Constant(free, {1, 0});
  EXPECT_EQ(fixed(without_0), 12 + 2 + kKnownLens + 6 + 1 + kSensorErrors - 2)
      << "gain and focal length are fixed already";
  EXPECT_TRUE(without_0[static_cast<std::size_t>(layout.Pose(0))]);
  EXPECT_FALSE(without_0[static_cast<std::size_t>(layout.Pose(1))]);
  FreeSet with_lens = free;
  with_lens.lens = {1};
  const std::vector<char> lens_without_0 = layout.Constant(with_lens, {1, 0});
  EXPECT_TRUE(lens_without_0[static_cast<std::size_t>(layout.Error(0, kFocal))]);
  EXPECT_FALSE(lens_without_0[static_cast<std::size_t>(layout.Error(1, kFocal))]);
}

TEST(AskedFor, LeavesOutWhatAPriorOfZeroFixes) {
  Priors priors = SomePriors();
  priors.gain = 0;
  priors.size = 0;
  const FreeSet free = AskedFor(ParseEstimate("auto"), priors, 2);
  EXPECT_FALSE(free.size);
  EXPECT_FALSE(free.gain);
  EXPECT_TRUE(free.offset);
  EXPECT_FALSE(AskedFor(ParseEstimate("size"), SomePriors(), 1).boxes);
}

TEST(FrameState, CorrectsAlongTheRay) {
  const FrameState sensor{Pose::Identity(), 0.01, 0.02};
  const Eigen::Vector3d p(0.3, -0.2, 2);
  const Eigen::Vector3d corrected = sensor.Corrected(p);
  EXPECT_NEAR(corrected.z(), 2 * 1.01 + 0.02, 1e-12);
  EXPECT_NEAR(corrected.x() / corrected.z(), 0.15, 1e-12);
}

/// Two sensors in two captures, the second in the second only, and boxes that stand anywhere. The
/// third frame is fixed.
struct Handmade {
  Structure structure = PaperStructure();
  SensorPoints nothing;
  RefineOptions options;
  std::vector<FrameInput> frames;
  Pose placement = MakePose({0, 0.7, 0}, {0.4, 0.01, -0.3});
  Solution solution;

  Handmade() {
    const std::vector<Pose> poses = {RingPose(20), RingPose(70), RingPose(140)};
    for (int i = 0; i < 3; ++i) {
      const Pose& pose = poses[static_cast<std::size_t>(i)];
      frames.push_back({Borrowed(nothing), pose, -1, i / 2, i == 0 ? 0 : 1});
    }
    const JointProblem problem = Problem();
    solution.state = NominalState(structure, poses, problem.lenses, problem.frame_of,
                                  {Pose::Identity(), placement});
    for (std::vector<double>& capture : solution.state.boxes) {
      for (double& value : capture) value = 0.001 * next_++;
    }
    solution.state.UpdateBuilt(problem.model);
    solution.free.boxes = true;
    solution.fixed = {0, 0, 1};
    solution.observed.resize(3);
  }
  JointProblem Problem() const { return {structure, frames, options, {}, 2}; }

 private:
  int next_ = 1;
};

Pose SensorFromBox(const State& state, std::size_t frame, std::size_t box) {
  return state.poses[frame].ToPose().inverse() * state.Built(frame).boxes()[box].structure_from_box;
}

Pose FirstFromSensor(const State& state, std::size_t frame) {
  return state.placements[state.EvaluationCaptureOf(frame)].ToPose() * state.poses[frame].ToPose();
}

TEST(CentreBoxes, MovesNothingAgainstAnythingElse) {
  Handmade made;
  const State before = made.solution.state;
  CentreBoxes(made.Problem(), &made.solution);
  const State& after = made.solution.state;
  for (std::size_t capture = 0; capture < 2; ++capture) {
    double x = 0, z = 0;
    for (int b = 0; b < 4; ++b) {
      const auto k = static_cast<std::size_t>(b);
      const auto at = [&](const State& state, int parameter) {
        return state.boxes[capture][static_cast<std::size_t>(parameter)];
      };
      EXPECT_EQ(at(after, BuildModel::Yaw(b)), at(before, BuildModel::Yaw(b)));
      x += at(after, BuildModel::X(b));
      z += at(after, BuildModel::Z(b));
      EXPECT_TRUE(
          SensorFromBox(after, capture, k).isApprox(SensorFromBox(before, capture, k), 1e-12))
          << capture << " " << b;
    }
    EXPECT_NEAR(x, 0, 1e-15);
    EXPECT_NEAR(z, 0, 1e-15);
  }
  const auto second_from_first = [](const State& state) -> Pose {
    return FirstFromSensor(state, 1).inverse() * FirstFromSensor(state, 0);
  };
  EXPECT_TRUE(second_from_first(after).isApprox(second_from_first(before), 1e-12));
  EXPECT_TRUE(after.placements[0].ToPose().isApprox(Pose::Identity(), 1e-15));
  EXPECT_TRUE(after.poses[2].ToPose().isApprox(made.frames[2].start, 1e-12));
}

TEST(CentreBoxes, LeavesBoxesThatAreNotEstimated) {
  Handmade made;
  made.solution.free.boxes = false;
  const State before = made.solution.state;
  CentreBoxes(made.Problem(), &made.solution);
  EXPECT_EQ(made.solution.state.boxes, before.boxes);
  EXPECT_TRUE(made.solution.state.poses[0].ToPose().isApprox(before.poses[0].ToPose(), 1e-15));
}

}  // namespace
}  // namespace volalign::refine_internal::parameters_test

#include "infer/refine/fine_problem.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "infer/refine/fine.h"
#include "tests/infer/refine/points_and_evidence.h"

namespace volalign::refine_internal {
namespace {

using testing_infer::Neighbours;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

/// Residual blocks of overlap: those that two poses have in common.
std::vector<ceres::ResidualBlockId> OverlapBlocks(const CeresProblem& ceres, const State& state) {
  std::vector<ceres::ResidualBlockId> blocks, common;
  ceres.problem->GetResidualBlocksForParameterBlock(state.poses[0].values, &blocks);
  for (const ceres::ResidualBlockId& block : blocks) {
    std::vector<double*> parameters;
    ceres.problem->GetParameterBlocksForResidualBlock(block, &parameters);
    for (const double* parameter : parameters) {
      if (parameter == state.poses[1].values) common.push_back(block);
    }
  }
  return common;
}

int OverlapTerms(const CeresProblem& ceres, const State& state) {
  return static_cast<int>(OverlapBlocks(ceres, state).size());
}

TEST(BuildFineProblem, CountsOverlapFromMinOverlapOn) {
  const Neighbours made;
  const auto terms = [&](double min_overlap) {
    RefineOptions options;
    options.min_overlap = min_overlap;
    const JointProblem problem(made.rig.structure, made.frames, options);
    State state = NominalState(made.rig.structure, made.poses);
    const FreeSet free = AskedFor({}, problem.priors, 2, 4);
    const std::vector<SensorEvidence> evidence = GatherEvidence(problem, state, free, {});
    const CeresProblem ceres =
        BuildFineProblem(problem, evidence, {0, 0}, problem.layout.Constant(free), &state);
    return OverlapTerms(ceres, state);
  };
  EXPECT_GT(terms(0.05), 20);
  EXPECT_EQ(terms(0.05), terms(0.01));
  EXPECT_EQ(terms(0.95), 0) << "neighbours do not see nearly all of each other's view";
}

/// 30 points of a plane at 2 m that faces the sensor, along the image's x or y axis: 1.2 m, four
/// correlation lengths of 0.15 rad.
std::vector<CloudPoint> Strip(bool along_x, double z) {
  std::vector<CloudPoint> cloud;
  for (int i = 0; i < 15; ++i) {
    for (const double across : {0.02, 0.1}) {
      const double along = 0.01 + 0.083 * i;
      CloudPoint point;
      point.p = along_x ? Eigen::Vector3d(along, across, z) : Eigen::Vector3d(across, along, z);
      point.normal = {0, 0, -1};
      point.use = BlockUse::kFit;
      cloud.push_back(point);
    }
  }
  return cloud;
}

TEST(BuildFineProblem, ErrorsWithinACorrelationLengthAreOneError) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  constexpr double kApart = 0.001;  // m
  for (const bool along_x : {true, false}) {
    SensorPoints a({}, {}, Strip(along_x, 2)), b({}, {}, Strip(along_x, 2 + kApart));
    a.intrinsics = b.intrinsics = testing_infer::Kinect();
    const std::vector<RefineFrame> frames = {{&a, pose, pose, pose, false},
                                             {&b, pose, pose, pose, false}};
    const RefineOptions options;
    const JointProblem problem(structure, frames, options);
    State state = NominalState(structure, {pose, pose});
    const FreeSet free = AskedFor({}, problem.priors, 2, 4);
    const std::vector<SensorEvidence> evidence(2);
    ASSERT_EQ(evidence[0].noise.warp_length, 0.15);
    const CeresProblem ceres =
        BuildFineProblem(problem, evidence, {0, 0}, problem.layout.Constant(free), &state);
    double cost = 0;
    for (const ceres::ResidualBlockId& block : OverlapBlocks(ceres, state)) {
      double of_block = 0;
      ASSERT_TRUE(ceres.problem->EvaluateResidualBlock(block, false, &of_block, nullptr, nullptr));
      cost += of_block;
    }
    // Each way, 30 points count as four: of the smooth error of both, 3 mm, and of two thousandths
    // of their distances from the optical axis.
    double expected = 0;
    for (const CloudPoint& point : a.cloud()) {
      const double variance = 2 * (0.003 * 0.003 + 0.002 * 0.002 * point.p.head<2>().squaredNorm());
      expected += 0.5 * kApart * kApart / variance * 4 / 30;
    }
    EXPECT_NEAR(cost, 2 * expected, 0.01 * expected) << along_x;
  }
}

TEST(BuildFineProblem, HoldsWhatIsNotFree) {
  const Neighbours made;
  const RefineOptions options;
  const JointProblem problem(made.rig.structure, made.frames, options);
  State state = NominalState(made.rig.structure, made.poses);
  FreeSet free = AskedFor({}, problem.priors, 2, 4);
  free.size = true;
  free.offset[1] = 1;
  const std::vector<SensorEvidence> evidence = GatherEvidence(problem, state, free, {});
  const CeresProblem ceres =
      BuildFineProblem(problem, evidence, {1, 0}, problem.layout.Constant(free, {1, 0}), &state);
  EXPECT_TRUE(ceres.problem->IsParameterBlockConstant(state.poses[0].values));
  EXPECT_TRUE(ceres.problem->IsParameterBlockConstant(state.nuisances[0].data()));
  EXPECT_FALSE(ceres.problem->IsParameterBlockConstant(state.poses[1].values));
  EXPECT_FALSE(ceres.problem->IsParameterBlockConstant(&state.offsets[1]));
  EXPECT_TRUE(ceres.problem->IsParameterBlockConstant(&state.gains[1]));
  EXPECT_FALSE(ceres.problem->IsParameterBlockConstant(state.nuisances[1].data()));
  EXPECT_FALSE(ceres.problem->IsParameterBlockConstant(&state.size));
  EXPECT_TRUE(ceres.problem->IsParameterBlockConstant(state.boxes[0].data()));
  EXPECT_EQ(OverlapTerms(ceres, state), 0) << "one of the two stays where it is";
}

}  // namespace
}  // namespace volalign::refine_internal

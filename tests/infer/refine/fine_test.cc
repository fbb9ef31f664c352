#include "infer/refine/fine.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/infer/refine/points_and_evidence.h"

namespace volalign::refine_internal {
namespace {

using testing_infer::PaperStructure;
using testing_infer::PointsOf;
using testing_infer::Rig;
using testing_infer::RingPose;

/// Two neighbours that see the structure and the floor, where they stand.
struct Neighbours {
  Rig rig{PaperStructure(), {}, {}};
  std::vector<SensorPoints> points;
  std::vector<RefineSensor> sensors;
  std::vector<Pose> poses;

  Neighbours() {
    rig.Add("A", RingPose(40));
    rig.Add("B", RingPose(85));
    points = PointsOf(rig);
    for (std::size_t i = 0; i < 2; ++i) {
      const Pose& truth = *rig.frames[i].ground_truth;
      poses.push_back(truth);
      sensors.push_back({&points[i], truth, truth, truth, true});
    }
  }
};

/// Residual blocks of overlap: those that two poses have in common.
int OverlapTerms(const CeresProblem& ceres, const State& state) {
  std::vector<ceres::ResidualBlockId> blocks;
  ceres.problem->GetResidualBlocksForParameterBlock(state.poses[0].values, &blocks);
  int count = 0;
  for (const ceres::ResidualBlockId& block : blocks) {
    std::vector<double*> parameters;
    ceres.problem->GetParameterBlocksForResidualBlock(block, &parameters);
    for (const double* parameter : parameters) count += parameter == state.poses[1].values;
  }
  return count;
}

TEST(BuildFineProblem, CountsOverlapFromMinOverlapOn) {
  const Neighbours made;
  const auto terms = [&](double min_overlap) {
    RefineOptions options;
    options.min_overlap = min_overlap;
    const JointProblem problem(made.rig.structure, made.sensors, options);
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

TEST(BuildFineProblem, HoldsWhatIsNotFree) {
  const Neighbours made;
  const RefineOptions options;
  const JointProblem problem(made.rig.structure, made.sensors, options);
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
  EXPECT_EQ(ceres.problem->ParameterBlockTangentSize(state.nuisances[1].data()), 3) << "no gain";
  EXPECT_FALSE(ceres.problem->IsParameterBlockConstant(&state.size));
  EXPECT_TRUE(ceres.problem->IsParameterBlockConstant(state.boxes[0].data()));
  EXPECT_EQ(OverlapTerms(ceres, state), 0) << "one of the two stays where it is";
}

TEST(SolveFine, GivesNothingWhereTheCostIsNotFinite) {
  const Neighbours made;
  const RefineOptions options;
  const JointProblem problem(made.rig.structure, made.sensors, options);
  Solution solution{
      AskedFor({}, problem.priors, 2, 4), NominalState(made.rig.structure, made.poses), {}, {0, 0}};
  solution.evidence = GatherEvidence(problem, solution.state, solution.free, {});
  EXPECT_TRUE(IsUsable(problem, solution, 0));
  EXPECT_TRUE(SolveFine(problem, solution).has_value());
  solution.evidence[0].face_root(0, 0) = std::nan("");
  EXPECT_FALSE(IsUsable(problem, solution, 0));
  EXPECT_TRUE(IsUsable(problem, solution, 1));
  EXPECT_FALSE(SolveFine(problem, solution).has_value());
}

TEST(IterateFine, GoesOnWithoutASensorThatHasNoPose) {
  Neighbours made;
  made.sensors[0].start.translation().x() = std::nan("");
  const RefineOptions options;
  const JointProblem problem(made.rig.structure, made.sensors, options);
  const Solution solution = IterateFine(
      problem, {AskedFor({}, problem.priors, 2, 4),
                NominalState(made.rig.structure, {made.sensors[0].start, made.poses[1]}),
                {},
                {0, 0}});
  EXPECT_EQ(solution.kept_initial, (std::vector<char>{1, 0}));
  EXPECT_TRUE(solution.state.poses[0].ToPose().isApprox(made.poses[0], 1e-12)) << "its fallback";
  EXPECT_TRUE(solution.evidence[0].faces.empty());
  EXPECT_LT(ComparePoses(solution.state.poses[1].ToPose(), made.poses[1]).translation_m, 3e-3);
}

}  // namespace
}  // namespace volalign::refine_internal

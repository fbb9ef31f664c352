#include "infer/refine/solution.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::solution_test {
namespace {

using testing_infer::Neighbours;

TEST(Solve, GivesNothingWhereTheCostIsNotFinite) {
  const Neighbours made;
  const RefineOptions options;
  const JointProblem problem(made.rig.structure, made.frames, options);
  Solution solution{
      AskedFor({}, problem.priors, 2, 4), NominalState(made.rig.structure, made.poses), {}, {0, 0}};
  solution.observed = GatherObservations(problem, solution.state, solution.free, {});
  EXPECT_TRUE(IsUsable(problem, solution, 0));
  EXPECT_TRUE(Solve(problem, &solution));
  solution.observed[0].face_root(0, 0) = std::nan("");
  EXPECT_FALSE(IsUsable(problem, solution, 0));
  EXPECT_TRUE(IsUsable(problem, solution, 1));
  EXPECT_FALSE(Solve(problem, &solution));
}

TEST(GatherObservations, KeepsErrorsThatWereFittedEarlier) {
  Neighbours made;
  const auto gather = [&] {
    const JointProblem problem(made.rig.structure, made.frames, RefineOptions());
    return GatherObservations(problem, NominalState(made.rig.structure, made.poses),
                              AskedFor({}, problem.priors, 2, 4), {});
  };
  const std::vector<FrameObservations> fitted = gather();
  for (const std::size_t i : {0, 1}) made.frames[i].noise = fitted[i].noise;
  const std::vector<FrameObservations> same = gather();
  for (const std::size_t i : {0, 1}) {
    EXPECT_GT(same[i].face_root.rows(), 0);
    EXPECT_TRUE(same[i].face_root.isApprox(fitted[i].face_root, 1e-12)) << "by the same errors";
    made.frames[i].noise->depth.smooth_m *= 2;
  }
  const std::vector<FrameObservations> kept = gather();
  for (const std::size_t i : {0, 1})
    EXPECT_EQ(kept[i].noise.depth.smooth_m, 2 * fitted[i].noise.depth.smooth_m) << "not fitted";
}

TEST(AssociateAndSolve, GoesOnWithoutASensorThatHasNoPose) {
  Neighbours made;
  made.frames[0].start.translation().x() = std::nan("");
  const RefineOptions options;
  const JointProblem problem(made.rig.structure, made.frames, options);
  const Solution solution = AssociateAndSolve(
      problem, {AskedFor({}, problem.priors, 2, 4),
                NominalState(made.rig.structure, {made.frames[0].start, made.poses[1]}),
                {},
                {0, 0}});
  EXPECT_EQ(solution.held, (std::vector<char>{1, 0}));
  EXPECT_TRUE(solution.state.poses[0].ToPose().isApprox(made.poses[0], 1e-12)) << "its fallback";
  EXPECT_TRUE(solution.observed[0].faces.empty());
  EXPECT_LT(ComparePoses(solution.state.poses[1].ToPose(), made.poses[1]).translation_m, 3e-3);
}

}  // namespace
}  // namespace volalign::refine_internal::solution_test

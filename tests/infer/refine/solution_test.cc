#include "infer/refine/solution.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "core/geometry/frame_errors.h"
#include "core/geometry/sensor_kind.h"
#include "infer/refine/noise.h"
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

// Depths of two sensors: light that bounces adds 4 mm times its share to those of one and nothing
// to those of the other, and a side that both see bulges by 3 mm.
TEST(Solve, TellsBouncedLightAndBulgesFromPoses) {
  const Neighbours made;
  const Structure& structure = made.rig.structure;
  RefineOptions options;
  options.max_overlap_points = 0;
  const JointProblem problem(structure, made.frames, options);
  Solution solution{
      AskedFor({}, problem.priors, 2, 4), NominalState(structure, made.poses), {}, {0, 0}};
  constexpr double kBounce = 0.004, kBulge = 0.003;
  std::map<int, int> seen;
  for (const Pose& pose : made.poses) {
    for (const FaceObservation& face : testing_infer::Observe(structure, pose, 8).faces)
      ++seen[face.label];
  }
  const int bulging = std::max_element(seen.begin(), seen.end(), [](const auto& a, const auto& b) {
                        return a.second < b.second;
                      })->first;
  for (std::size_t i = 0; i < 2; ++i) {
    FrameObservations observed = testing_infer::Observe(structure, made.poses[i], 8);
    const DepthErrorModel errors = ErrorsOf("");
    for (FaceObservation& face : observed.faces) {
      const Side& side = structure.SideOfLabel(face.label);
      const Eigen::Vector3d normal = made.poses[i].linear().transpose() * side.normal;
      face.multipath = 0;
      face.by_errors = FrameErrorsAt(errors, face.p, normal);
      face.by_errors[kBounced] = BouncedShare(structure, side, made.poses[i] * face.p,
                                              made.poses[i].translation(), errors.bounce_reach_m);
      const double share = face.by_errors[kBounced];
      if (face.label == bulging) face.p += kBulge * face.bulge / normal.dot(face.p) * face.p;
      if (i == 0) face.p *= 1 + kBounce * share / face.p.z();
    }
    observed.noise.depth.smooth_m = 0.0005;
    SetCovariance(problem.model, made.poses[i], &observed);
    solution.observed.push_back(std::move(observed));
  }
  ASSERT_TRUE(Solve(problem, &solution));
  EXPECT_NEAR(solution.state.errors[0][kBounced], -kBounce, 0.1 * kBounce);
  EXPECT_NEAR(solution.state.errors[1][kBounced], 0, 0.1 * kBounce);
  for (int label = 1; label < structure.num_classes(); ++label) {
    EXPECT_NEAR(solution.state.bulges[0][static_cast<std::size_t>(BuildModel::Bulge(label))],
                label == bulging ? kBulge : 0, 0.2 * kBulge)
        << label;
  }
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_LT(ComparePoses(solution.state.poses[i].ToPose(), made.poses[i]).translation_m, 1.5e-3);
    EXPECT_LT(ComparePoses(solution.state.poses[i].ToPose(), made.poses[i]).rotation_deg, 0.05);
  }
}

TEST(HoldFrame, LeavesNoErrors) {
  const Neighbours made;
  const JointProblem problem(made.rig.structure, made.frames, RefineOptions());
  Solution solution{
      AskedFor({}, problem.priors, 2, 4), NominalState(made.rig.structure, made.poses), {}, {0, 0}};
  for (std::size_t i = 0; i < 2; ++i) {
    solution.state.errors[i].fill(0.001);
    solution.state.nuisances[i].fill(0.001);
  }
  HoldFrame(problem, 0, &solution);
  EXPECT_EQ(solution.state.errors[0], (std::array<double, kFrameErrors>{}));
  EXPECT_EQ(solution.state.nuisances[0], (std::array<double, kNuisances>{}));
  EXPECT_EQ(solution.state.errors[1][kBounced], 0.001) << "another frame";
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

TEST(AssociateAndSolve, GoesOnWithoutASensorWhoseNumbersFail) {
  Neighbours made;
  made.frames[0].noise = UsualNoise("");
  made.frames[0].noise->depth.smooth_m = std::nan("");
  const RefineOptions options;
  const JointProblem problem(made.rig.structure, made.frames, options);
  const Solution solution =
      AssociateAndSolve(problem, {AskedFor({}, problem.priors, 2, 4),
                                  NominalState(made.rig.structure, made.poses),
                                  {},
                                  {0, 0}});
  EXPECT_EQ(solution.held, (std::vector<char>{1, 0}));
  EXPECT_TRUE(solution.state.poses[0].ToPose().isApprox(made.poses[0], 1e-12)) << "its start";
  EXPECT_TRUE(solution.observed[0].faces.empty());
  EXPECT_LT(ComparePoses(solution.state.poses[1].ToPose(), made.poses[1]).translation_m, 3e-3);
}

}  // namespace
}  // namespace volalign::refine_internal::solution_test

#include "infer/refine/solver.h"

#include <ceres/sized_cost_function.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/frame_errors.h"
#include "core/geometry/sensor_kind.h"
#include "infer/refine/build_model.h"
#include "infer/refine/noise.h"
#include "infer/refine/options.h"
#include "infer/refine/pose_manifold.h"
#include "infer/refine/solution.h"
#include "tests/core/base/expect_error.h"
#include "tests/infer/refine/points_and_observations.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::refine_internal::solver_test {
namespace {

using namespace testing_infer;

/// x - 3, or nothing at all.
class Line : public ceres::SizedCostFunction<1, 2> {
 public:
  explicit Line(bool works) : works_(works) {}
  bool Evaluate(double const* const* x, double* residual, double** jacobians) const override {
    residual[0] = x[0][0] - 3 + x[0][1];
    if (jacobians && jacobians[0]) jacobians[0][0] = jacobians[0][1] = 1;
    return works_;
  }

 private:
  bool works_;
};

TEST(Minimise, SaysWhetherItCouldAndWhetherItEndedByItsTolerance) {
  for (const auto& [works, steps] :
       {std::pair(true, 20), std::pair(true, 1), std::pair(false, 20)}) {
    RefineOptions options;
    options.inner_iterations = steps;
    CeresProblem ceres;
    std::vector<double> x = {1, 0.5};
    ceres.problem->AddResidualBlock(new Line(works), nullptr, x.data());
    ceres.HoldConstant(x.data(), 2, {1});
    const Minimum minimum = Minimise(options, ceres.problem.get());
    EXPECT_EQ(minimum.usable, works);
    EXPECT_EQ(minimum.converged, works && steps == 20);
    EXPECT_NEAR(x[0], works ? 2.5 : 1, 1e-3);
    EXPECT_EQ(x[1], 0.5) << "held";
  }
}

TEST(LeftPoseManifold, PlusIsPerturbLeft) {
  RandomStream random(5, 0, "plus");
  for (int trial = 0; trial < 30; ++trial) {
    const Pose pose = RandomPose(random);
    Vector6d delta;
    for (int i = 0; i < 6; ++i) delta[i] = random.Normal(0, trial % 2 ? 0.5 : 1e-9);
    const PoseBlock x(pose);
    PoseBlock y;
    ASSERT_TRUE(LeftPoseManifold().Plus(x.values, delta.data(), y.values));
    EXPECT_TRUE(y.ToPose().isApprox(PerturbLeft(delta, pose), 1e-12));
    EXPECT_LT((LeftDifference(pose, y.ToPose()) - delta).norm(), 1e-9);
    // A small step before another pose is the step of its adjoint behind it.
    const Pose other = RandomPose(random);
    const Vector6d step = 1e-6 * delta.normalized();
    const Vector6d turned = LeftDifference(other * pose, other * PerturbLeft(step, pose));
    EXPECT_LT((turned - Adjoint(other) * step).norm(), 1e-9);
    Vector6d back;
    ASSERT_TRUE(LeftPoseManifold().Minus(y.values, x.values, back.data()));
    EXPECT_LT((back - delta).norm(), 1e-9);
  }
}

// PlusJacobian itself is against differences in the test of the columns (parameters_test.cc).
TEST(LeftPoseManifold, MinusJacobianUndoesPlusJacobian) {
  RandomStream random(6, 0, "manifold");
  const LeftPoseManifold manifold;
  for (int trial = 0; trial < 10; ++trial) {
    const PoseBlock x(RandomPose(random));
    Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
    Eigen::Matrix<double, 6, 7, Eigen::RowMajor> minus;
    manifold.PlusJacobian(x.values, plus.data());
    manifold.MinusJacobian(x.values, minus.data());
    EXPECT_TRUE((minus * plus).isIdentity(1e-12));
  }
}

TEST(BuildModel, MovesTurnsAndGrowsOnTheSameFloor) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  std::vector<double> boxes(3 * structure.boxes().size(), 0);
  EXPECT_EQ(boxes.size(), 3 * structure.boxes().size());
  const double size = 0.02;
  boxes[static_cast<std::size_t>(BuildModel::X(1))] = 0.003;
  boxes[static_cast<std::size_t>(BuildModel::Z(1))] = -0.004;
  boxes[static_cast<std::size_t>(BuildModel::Yaw(1))] = M_PI / 2;
  const Structure built = model.Built({&size, boxes.data()});
  EXPECT_NEAR(built.FloorHeight(), structure.FloorHeight(), 1e-9);
  for (std::size_t b = 0; b < structure.boxes().size(); ++b) {
    const Box &before = structure.boxes()[b], &after = built.boxes()[b];
    EXPECT_TRUE(after.size.isApprox(1.02 * before.size, 1e-12));
    Eigen::Vector3d expected = before.structure_from_box.translation();
    expected.y() += 0.02 * (expected.y() - structure.FloorHeight());
    if (b == 1) expected += Eigen::Vector3d(0.003, 0, -0.004);
    EXPECT_TRUE(after.structure_from_box.translation().isApprox(expected, 1e-9)) << b;
    // A quarter turn about the vertical takes +x to -z.
    const Eigen::Vector3d x = after.structure_from_box.linear().col(0),
                          was = before.structure_from_box.linear().col(0);
    const Eigen::Vector3d turned = b == 1 ? Eigen::Vector3d(was.z(), was.y(), -was.x()) : was;
    EXPECT_TRUE(x.isApprox(turned, 1e-9)) << b;
  }
}

TEST(ParseEstimate, NamesItsWords) {
  EXPECT_TRUE(ParseEstimate("auto").boxes);
  EXPECT_TRUE(ParseEstimate("auto").depth_offset);
  EXPECT_FALSE(ParseEstimate("none").size);
  const EstimateSet two = ParseEstimate("size, depth_gain");
  EXPECT_TRUE(two.size && two.depth_gain);
  EXPECT_FALSE(two.boxes || two.depth_offset);
  for (const char* bad : {"", "boxes,,size", "box", "auto,size", "size,"})
    ExpectError<ConfigError>([&] { ParseEstimate(bad); }, {"refine.estimate", "depth_offset"});
}

// Depths of two sensors: light that bounces adds 4 mm times its share to those of one and nothing
// to those of the other, and a side that both see bulges by 3 mm.
TEST(Solve, TellsMultipathAndBulgesFromPoses) {
  const Neighbours made;
  const Structure& structure = made.rig.structure;
  RefineOptions options;
  options.max_overlap_points = 0;
  const JointProblem problem(structure, made.frames, options);
  Solution solution{
      AskedFor({}, problem.priors, 2), NominalState(structure, made.poses), {}, {0, 0}};
  constexpr double kBounce = 0.004, kBulge = 0.003;
  std::map<int, int> seen;
  for (const Pose& pose : made.poses) {
    for (const FaceObservation& face : Observe(structure, pose, 8).faces) ++seen[face.label];
  }
  const int bulging = std::max_element(seen.begin(), seen.end(), [](const auto& a, const auto& b) {
                        return a.second < b.second;
                      })->first;
  for (std::size_t i = 0; i < 2; ++i) {
    FrameObservations observed = Observe(structure, made.poses[i], 8);
    const DepthErrorModel errors = ErrorsOf("");
    for (FaceObservation& face : observed.faces) {
      const Side& side = structure.SideOfLabel(face.label);
      const Eigen::Vector3d normal = made.poses[i].linear().transpose() * side.normal;
      face.by_errors.setZero();
      face.by_errors.head<kFrameErrors>() = FrameErrorsAt(errors, face.p, normal);
      face.by_errors[kDiffuseMultipath] =
          DiffuseMultipathShare(structure, side, made.poses[i] * face.p,
                                made.poses[i].translation(), errors.bounce_reach_m);
      const double share = face.by_errors[kDiffuseMultipath];
      if (face.label == bulging) face.p += kBulge * face.bulge / normal.dot(face.p) * face.p;
      if (i == 0) face.p *= 1 + kBounce * share / face.p.z();
    }
    observed.noise.depth.smooth_m = 0.0005;
    SetCovariance(problem.model, made.poses[i], &observed);
    solution.observed.push_back(std::move(observed));
  }
  ASSERT_TRUE(Solve(problem, &solution));
  EXPECT_NEAR(solution.state.errors[0][kDiffuseMultipath], -kBounce, 0.1 * kBounce);
  EXPECT_NEAR(solution.state.errors[1][kDiffuseMultipath], 0, 0.1 * kBounce);
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
      AskedFor({}, problem.priors, 2), NominalState(made.rig.structure, made.poses), {}, {0, 0}};
  for (std::size_t i = 0; i < 2; ++i) {
    solution.state.errors[i].fill(0.001);
  }
  HoldFrame(problem, 0, &solution);
  EXPECT_TRUE(solution.state.errors[0].isZero());
  EXPECT_EQ(solution.state.errors[1][kDiffuseMultipath], 0.001) << "another frame";
}

}  // namespace
}  // namespace volalign::refine_internal::solver_test

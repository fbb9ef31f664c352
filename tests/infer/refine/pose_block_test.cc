#include "infer/refine/pose_manifold.h"

#include <gtest/gtest.h>

#include "core/base/random.h"

namespace volalign::refine_internal::pose_block_test {
namespace {

Eigen::Vector3d RandomVector(RandomStream& random, double scale) {
  return {random.Normal(0, scale), random.Normal(0, scale), random.Normal(0, scale)};
}

Pose RandomPose(RandomStream& random) {
  Pose pose = Pose::Identity();
  pose.linear() = RotationExp(RandomVector(random, 1.5));
  pose.translation() = RandomVector(random, 2);
  return pose;
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
    Vector6d back;
    ASSERT_TRUE(LeftPoseManifold().Minus(y.values, x.values, back.data()));
    EXPECT_LT((back - delta).norm(), 1e-9);
  }
}

TEST(LeftPoseManifold, JacobiansAreDerivatives) {
  RandomStream random(6, 0, "manifold");
  const LeftPoseManifold manifold;
  for (int trial = 0; trial < 10; ++trial) {
    const PoseBlock x(RandomPose(random));
    Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
    Eigen::Matrix<double, 6, 7, Eigen::RowMajor> minus;
    manifold.PlusJacobian(x.values, plus.data());
    manifold.MinusJacobian(x.values, minus.data());
    EXPECT_TRUE((minus * plus).isIdentity(1e-12));
    constexpr double kStep = 1e-6;
    for (int column = 0; column < 6; ++column) {
      Vector6d delta = Vector6d::Zero();
      delta[column] = kStep;
      PoseBlock high, low;
      manifold.Plus(x.values, delta.data(), high.values);
      delta[column] = -kStep;
      manifold.Plus(x.values, delta.data(), low.values);
      for (int row = 0; row < 7; ++row) {
        EXPECT_NEAR((high.values[row] - low.values[row]) / (2 * kStep), plus(row, column), 1e-6);
      }
    }
  }
}

}  // namespace
}  // namespace volalign::refine_internal::pose_block_test

#include "infer/formats/poses/sensor_pose.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::sensor_pose_test {
namespace {

TEST(PoseFromRotation, StraightensAMatrixOfFewDigitsAndRefusesOthers) {
  const Eigen::Matrix3d exact = RotationExp({0.3, -0.4, 0.5});
  Eigen::Matrix3d rounded = exact;
  for (int i = 0; i < 9; ++i) rounded(i) = std::round(1e4 * rounded(i)) / 1e4;
  const Eigen::Vector3d t(1, 2, 3);
  const Pose pose = PoseFromRotation(rounded, t, "file");
  EXPECT_LT((pose.linear() * pose.linear().transpose() - Eigen::Matrix3d::Identity()).norm(),
            1e-12);
  EXPECT_LT((pose.linear() - exact).norm(), 3e-4);
  EXPECT_EQ(pose.translation(), t);
  Eigen::Matrix3d mirrored = exact;
  mirrored.col(0) *= -1;
  const Eigen::Vector3d infinite(std::numeric_limits<double>::infinity(), 0, 0);
  ExpectError<DataError>([&] { PoseFromRotation(mirrored, t, "file"); }, {"file"});
  ExpectError<DataError>([&] { PoseFromRotation(1.01 * exact, t, "file"); }, {"file"});
  ExpectError<DataError>([&] { PoseFromRotation(exact, infinite, "file"); }, {"file"});
}

TEST(Quaternions, HaveWFirstAndNotNegative) {
  const double c = std::cos(0.35), s = std::sin(0.35);  // 0.7 about y
  const Pose pose = PoseFromQuaternion(c, 0, s, 0, {1, 2, 3}, "file");
  EXPECT_LT((pose.linear() - RotationExp({0, 0.7, 0})).norm(), 1e-12);
  EXPECT_EQ(pose.translation(), Eigen::Vector3d(1, 2, 3));
  ExpectError<DataError>([] { PoseFromQuaternion(1, 0, 0.1, 0, {0, 0, 0}, "file"); }, {"file"});
  for (const double angle : {0.7, 3.0, 3.3, -0.7}) {
    const Eigen::Quaterniond q = QuaternionOf(RotationExp({0, angle, 0}));
    EXPECT_GE(q.w(), 0);
    EXPECT_NEAR(q.w(), std::abs(std::cos(angle / 2)), 1e-12);
    EXPECT_LT((q.toRotationMatrix() - RotationExp({0, angle, 0})).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace volalign::sensor_pose_test

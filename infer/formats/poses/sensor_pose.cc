#include "infer/formats/poses/sensor_pose.h"

#include <fmt/format.h>

#include <cmath>

#include "core/base/error.h"

namespace volalign {

namespace {

constexpr double kTolerance = 1e-3;  // of a rotation that was written with few digits

}  // namespace

Eigen::Matrix3d ZUpFromYUp() {
  return (Eigen::Matrix3d() << 1, 0, 0, 0, 0, -1, 0, 1, 0).finished();
}

Eigen::Matrix3d UnityFromYUp() { return Eigen::Vector3d(-1, 1, 1).asDiagonal(); }

Eigen::Matrix3d UnityCameraFromSensor() { return Eigen::Vector3d(1, -1, 1).asDiagonal(); }

Eigen::Matrix3d KinectV2FromSensor() { return Eigen::Vector3d(-1, -1, 1).asDiagonal(); }

Pose PoseFromRotation(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation,
                      const std::string& what) {
  const bool rigid =
      rotation.allFinite() && translation.allFinite() &&
      (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() < kTolerance &&
      rotation.determinant() > 0;
  if (!rigid) throw DataError(fmt::format("{}: not a rotation and a finite position", what));
  Pose pose = Pose::Identity();
  pose.linear() = Eigen::Quaterniond(rotation).normalized().toRotationMatrix();
  pose.translation() = translation;
  return pose;
}

Pose PoseFromQuaternion(double w, double x, double y, double z, const Eigen::Vector3d& translation,
                        const std::string& what) {
  const Eigen::Quaterniond q(w, x, y, z);
  if (!(std::abs(q.norm() - 1) < kTolerance))
    throw DataError(fmt::format("{}: the quaternion's length is {}, not 1", what, q.norm()));
  return PoseFromRotation(q.normalized().toRotationMatrix(), translation, what);
}

Eigen::Quaterniond QuaternionOf(const Eigen::Matrix3d& rotation) {
  Eigen::Quaterniond q(rotation);
  q.normalize();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  return q;
}

}  // namespace volalign

#pragma once

// A pose as a block of Ceres parameters. Callers of Refine, which may use LibTorch, include this
// file, so it includes no header of Ceres.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>

#include "core/geometry/pose.h"

namespace volalign::refine_internal {

/// structure_from_sensor as a parameter block: unit quaternion x y z w, then translation.
struct PoseBlock {
  double values[7];

  PoseBlock() : PoseBlock(Pose::Identity()) {}
  explicit PoseBlock(const Pose& pose) {
    const Eigen::Vector4d q = Eigen::Quaterniond(pose.linear()).normalized().coeffs();
    const Eigen::Vector3d t = pose.translation();
    std::copy_n(q.data(), 4, values);
    std::copy_n(t.data(), 3, values + 4);
  }
  Pose ToPose() const { return ToPose(values); }
  static Pose ToPose(const double* block) {
    Pose pose = Pose::Identity();
    pose.linear() = Eigen::Quaterniond(block).normalized().toRotationMatrix();
    pose.translation() = Eigen::Map<const Eigen::Vector3d>(block + 4);
    return pose;
  }
};

/// d (R(q) p) / d (x y z w), 3x4. R(q) p = p + 2 w (u x p) + 2 u x (u x p), where q = (u, w).
inline Eigen::Matrix<double, 3, 4> RotatedPointJacobian(const double* q, const Eigen::Vector3d& p) {
  const Eigen::Vector3d u(q[0], q[1], q[2]);
  Eigen::Matrix<double, 3, 4> jacobian;
  jacobian.leftCols<3>() = -2 * q[3] * Cross(p) + 2 * (u.dot(p) * Eigen::Matrix3d::Identity() +
                                                       u * p.transpose() - 2 * p * u.transpose());
  jacobian.col(3) = 2 * u.cross(p);
  return jacobian;
}

}  // namespace volalign::refine_internal

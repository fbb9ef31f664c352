#pragma once

// Cost functions and manifold of the joint refinement, apart from the problem so that tests can
// differentiate them. Not for callers.

#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>

#include "core/pose.h"
#include "core/structure.h"

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
  Pose ToPose() const {
    Pose pose = Pose::Identity();
    pose.linear() = Eigen::Quaterniond(values).normalized().toRotationMatrix();
    pose.translation() = Eigen::Map<const Eigen::Vector3d>(values + 4);
    return pose;
  }
};

inline Eigen::Matrix3d Cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

/// d (R(q) p) / d (x y z w), 3x4, for R(q) p = p + 2 w (u x p) + 2 u x (u x p), q = (u, w).
inline Eigen::Matrix<double, 3, 4> RotatedPointJacobian(const double* q, const Eigen::Vector3d& p) {
  const Eigen::Vector3d u(q[0], q[1], q[2]);
  Eigen::Matrix<double, 3, 4> jacobian;
  jacobian.leftCols<3>() = -2 * q[3] * Cross(p) + 2 * (u.dot(p) * Eigen::Matrix3d::Identity() +
                                                       u * p.transpose() - 2 * p * u.transpose());
  jacobian.col(3) = 2 * u.cross(p);
  return jacobian;
}

/// T = Exp(delta) T^ with delta = [translation; rotation vector] in the structure frame: the
/// tangent space in which design section 9 wants the covariance.
class LeftPoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

/// A sensor's depth offset o as a parameter block of one: z is read as z + o, so p becomes p + o p
/// / p.z.
///
/// weight * (T p - closest point of the finite side), in the side's axes (u, v, normal): in-plane
/// parts vanish where the foot lies inside, so that it is point-to-plane there and point-to-edge or
/// point-to-corner outside.
class SideCost : public ceres::SizedCostFunction<3, 7, 1> {
 public:
  SideCost(const Eigen::Vector3d& p, const Side& side, double weight)
      : p_(p), side_(&side), weight_(weight) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector3d p_;
  const Side* side_;
  double weight_;
};

/// weight * (direction . T p - offset): a silhouette point against the line of its side's edge, or
/// a point of the floor against its plane. Depth offset as in SideCost.
class LineCost : public ceres::SizedCostFunction<1, 7, 1> {
 public:
  LineCost(const Eigen::Vector3d& p, const Eigen::Vector3d& direction, double offset, double weight)
      : p_(p), direction_(direction), offset_(offset), weight_(weight) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector3d p_, direction_;
  double offset_, weight_;
};

/// weight * n_b . (T_b^-1 T_a p_a - q_b): point of sensor a against the plane at q_b that sensor b
/// measured.
class OverlapCost : public ceres::SizedCostFunction<1, 7, 7, 1, 1> {
 public:
  OverlapCost(const Eigen::Vector3d& p_a, const Eigen::Vector3d& q_b, const Eigen::Vector3d& n_b,
              double weight)
      : p_(p_a), q_(q_b), n_(n_b), weight_(weight) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector3d p_, q_, n_;
  double weight_;
};

/// A loose prior on the pose: [(T p0 - T0 p0) / sigma_t; 2 vec(q q0^-1) / sigma_r], p0 the sensor's
/// point that T0 takes to the structure's origin. It decides nothing but directions that no
/// measurement constrains, whose variance it bounds.
class PosePriorCost : public ceres::SizedCostFunction<6, 7> {
 public:
  PosePriorCost(const Pose& prior, double sigma_translation, double sigma_rotation)
      : prior_(prior),
        origin_(prior.inverse().translation()),
        sigma_translation_(sigma_translation),
        sigma_rotation_(sigma_rotation) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  PoseBlock prior_;
  Eigen::Vector3d origin_;  // sensor frame
  double sigma_translation_, sigma_rotation_;
};

}  // namespace volalign::refine_internal

#include "infer/refine/pose_manifold.h"

namespace volalign::refine_internal {

bool LeftPoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const Vector6d step = Eigen::Map<const Vector6d>(delta);
  const Eigen::Vector3d w = step.tail<3>();
  const double angle = w.norm();
  Eigen::Quaterniond turn;
  if (angle > 0) {
    turn = Eigen::AngleAxisd(angle, w / angle);
  } else {
    turn = Eigen::Quaterniond(1, w.x() / 2, w.y() / 2, w.z() / 2);
  }
  const Eigen::Vector3d t(x[4], x[5], x[6]);
  const Eigen::Quaterniond q = (turn * Eigen::Quaterniond(x)).normalized();
  Eigen::Map<Eigen::Vector4d> out(x_plus_delta);
  out = q.coeffs();
  Eigen::Map<Eigen::Vector3d>(x_plus_delta + 4) = turn * t + step.head<3>();
  return true;
}

bool LeftPoseManifold::PlusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>> j(jacobian);
  const Eigen::Vector3d u(x[0], x[1], x[2]), t(x[4], x[5], x[6]);
  j.setZero();
  j.block<3, 3>(0, 3) = 0.5 * (x[3] * Eigen::Matrix3d::Identity() - Cross(u));
  j.block<1, 3>(3, 3) = -0.5 * u.transpose();
  j.block<3, 3>(4, 0).setIdentity();
  j.block<3, 3>(4, 3) = -Cross(t);
  return true;
}

bool LeftPoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Eigen::Quaterniond turn = Eigen::Quaterniond(y) * Eigen::Quaterniond(x).conjugate();
  const Eigen::Matrix3d rotation = turn.normalized().toRotationMatrix();
  const Eigen::Vector3d tx(x[4], x[5], x[6]), ty(y[4], y[5], y[6]);
  Eigen::Map<Vector6d> out(y_minus_x);
  out.tail<3>() = RotationLog(rotation);
  out.head<3>() = ty - rotation * tx;
  return true;
}

bool LeftPoseManifold::MinusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> j(jacobian);
  const Eigen::Vector3d u(x[0], x[1], x[2]), t(x[4], x[5], x[6]);
  Eigen::Matrix<double, 3, 4> turn;
  turn.leftCols<3>() = 2 * (x[3] * Eigen::Matrix3d::Identity() + Cross(u));
  turn.col(3) = -2 * u;
  j.setZero();
  j.block<3, 4>(0, 0) = Cross(t) * turn;
  j.block<3, 3>(0, 4).setIdentity();
  j.block<3, 4>(3, 0) = turn;
  return true;
}

}  // namespace volalign::refine_internal

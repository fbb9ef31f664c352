#pragma once

// How Ceres moves a pose. Not for callers of Refine.

#include <ceres/autodiff_manifold.h>

#include <Eigen/Geometry>

namespace volalign::refine_internal {

/// The tangent space in which covariances are given: T = Exp(delta) T^ with delta = [translation;
/// rotation vector] in the structure frame, m and rad.
struct LeftPerturbation {
  template <class T>
  bool Plus(const T* x, const T* delta, T* x_plus_delta) const {
    using Vector3 = Eigen::Matrix<T, 3, 1>;
    const Eigen::Map<const Vector3> v(delta), w(delta + 3), t(x + 4);
    Eigen::Quaternion<T> turn(T(1), w.x() / 2.0, w.y() / 2.0, w.z() / 2.0);
    if (w.squaredNorm() > 0.0) turn = Eigen::AngleAxis<T>(w.norm(), w.normalized());
    Eigen::Map<Eigen::Quaternion<T>> q(x_plus_delta);
    q = (turn * Eigen::Map<const Eigen::Quaternion<T>>(x)).normalized();
    Eigen::Map<Vector3>(x_plus_delta + 4) = turn * Vector3(t) + v;
    return true;
  }
  /// Ceres does not call it: no cost of ours is on a manifold.
  template <class T>
  bool Minus(const T* /*y*/, const T* /*x*/, T* /*y_minus_x*/) const {
    return false;
  }
};
using LeftPoseManifold = ceres::AutoDiffManifold<LeftPerturbation, 7, 6>;

}  // namespace volalign::refine_internal

#pragma once

// How Ceres moves a pose. Not for callers of Refine.

#include <ceres/manifold.h>

#include "infer/refine/pose_block.h"

namespace volalign::refine_internal {

/// The tangent space in which covariances are given: T = Exp(delta) T^ with delta = [translation;
/// rotation vector] in the structure frame, m and rad.
class LeftPoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

}  // namespace volalign::refine_internal

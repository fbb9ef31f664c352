#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "core/geometry/depth_error_model.h"
#include "infer/view/alike.h"

namespace volalign {

/// Distance, m, within which a point of this depth counts as on a surface: three standard
/// deviations of the depth's error, and the surface's own error. A table gives it, as each ray of
/// each candidate needs it.
class SurfaceTolerance {
 public:
  /// For a plane from the same frame, that one normal, or a few points, gave.
  static SurfaceTolerance OfPlane(const DepthErrorModel& errors) {
    return {kRoughPose / 2, errors, &DepthErrorModel::WithinSurface};
  }
  /// For the structure, at a pose that is not refined.
  static SurfaceTolerance AtRoughPose(const DepthErrorModel& errors) {
    return {kRoughPose, errors, &DepthErrorModel::Sigma};
  }
  /// For the structure, at a refined pose: boxes may be out of place.
  static SurfaceTolerance AtPose(const DepthErrorModel& errors) {
    return {kRoughPose / 2, errors, &DepthErrorModel::Sigma};
  }

  /// The tolerance at depth z, m. Constant beyond the table's end.
  double operator()(double z) const {
    const double at = std::clamp(z / kStep, 0.0, static_cast<double>(kSteps - 1));
    const auto below = std::min(static_cast<std::size_t>(at), kSteps - 2);
    const double share = at - static_cast<double>(below);
    return (1 - share) * table_[below] + share * table_[below + 1];
  }

 private:
  static constexpr double kStep = 0.1;  // m
  static constexpr std::size_t kSteps = 121;

  /// `surface`: m, the surface's own error.
  SurfaceTolerance(double surface, const DepthErrorModel& errors,
                   double (DepthErrorModel::*sigma)(double) const) {
    for (std::size_t i = 0; i < kSteps; ++i) {
      const double z = std::max(kStep / 10, kStep * static_cast<double>(i));
      table_[i] = std::hypot(surface, kClearly * (errors.*sigma)(z));
    }
  }

  std::array<double, kSteps> table_;
};

}  // namespace volalign

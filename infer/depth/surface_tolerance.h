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
  /// m: error of a plane that one normal, or a few points, gave.
  static constexpr double kRoughPlane = kRoughPose / 2;
  /// m: error of a surface of the structure at a refined pose, from boxes that are out of place.
  static constexpr double kRoughBoxes = kRoughPose / 2;

  /// For a plane from the same frame.
  static SurfaceTolerance OfPlane(const DepthErrorModel& errors) {
    return SurfaceTolerance(
        [&](double z) { return std::hypot(kRoughPlane, kClearly * errors.WithinSurface(z)); });
  }
  /// For the structure, at a pose that is not refined.
  static SurfaceTolerance AtRoughPose(const DepthErrorModel& errors) {
    return SurfaceTolerance(
        [&](double z) { return std::hypot(kRoughPose, kClearly * errors.Sigma(z)); });
  }
  /// For the structure, at a refined pose.
  static SurfaceTolerance AtPose(const DepthErrorModel& errors) {
    return SurfaceTolerance(
        [&](double z) { return std::hypot(kRoughBoxes, kClearly * errors.Sigma(z)); });
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

  template <class Tolerance>
  explicit SurfaceTolerance(const Tolerance& tolerance) {
    for (std::size_t i = 0; i < kSteps; ++i)
      table_[i] = tolerance(std::max(kStep / 10, kStep * static_cast<double>(i)));
  }

  std::array<double, kSteps> table_;
};

}  // namespace volalign

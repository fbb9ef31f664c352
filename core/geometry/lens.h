#pragma once

#include <Eigen/Core>
#include <string>

#include "core/geometry/camera.h"

namespace volalign {

/// Pixel of the normalised direction (x/z, y/z) with lens distortion: OpenCV's closed-form model
/// with 0, 4, 5 or 8 coefficients (k1 k2 p1 p2 k3 k4 k5 k6).
Eigen::Vector2d ProjectRay(const Intrinsics& intrinsics, const Eigen::Vector2d& ray);

/// A direction after the lens bent it, on the plane z = 1.
struct BentRay {
  Eigen::Vector2d bent;
  Eigen::Matrix2d by_ray;  ///< derivative by the direction; its determinant is 0 at a fold
  /// Denominator of the radial factor. The numerator's k1 and k2 move the bent ray by r^2 and r^4
  /// of the direction, divided by this.
  double denominator;
};
BentRay BendRay(const Intrinsics& intrinsics, const Eigen::Vector2d& ray);

/// Throws DataError, which begins with `what`, if the lens model has no ray for more than half of
/// the picture (of 32 x 32 pixels of it). The coefficients are then in a wrong order, or of another
/// lens.
void RequireRays(const Intrinsics& intrinsics, const std::string& what);

/// Rays of every pixel, for a pinhole or a camera with a lens. A pixel has a NaN ray if no ray in
/// front of the camera reaches it before the lens model folds over. Throws DataError for invalid
/// intrinsics, and as RequireRays.
RayTable ComputeRays(const Intrinsics& intrinsics);

}  // namespace volalign

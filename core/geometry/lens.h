#pragma once

#include <Eigen/Core>
#include <string>

#include "core/geometry/camera.h"

namespace volalign {

/// Pixel of the normalised direction (x/z, y/z), lens distortion included: OpenCV's closed-form
/// model with 0, 4, 5 or 8 coefficients (k1 k2 p1 p2 k3 k4 k5 k6).
Eigen::Vector2d ProjectRay(const Intrinsics& intrinsics, const Eigen::Vector2d& ray);

/// A direction on the plane z = 1 as a lens bends it there.
struct BentRay {
  Eigen::Vector2d bent;
  Eigen::Matrix2d by_ray;  ///< derivative by the direction; its determinant is 0 at a fold
  /// Of the radial factor: the numerator's k1 and k2 move the bent ray by r^2 and r^4 of the
  /// direction, over this.
  double denominator;
};
BentRay BendRay(const Intrinsics& intrinsics, const Eigen::Vector2d& ray);

/// Throws DataError, which `what` begins, for a lens whose model no ray follows at more than half
/// of the picture (of 32 x 32 pixels of it): the coefficients are in a wrong order, or another
/// lens's.
void RequireRays(const Intrinsics& intrinsics, const std::string& what);

/// Rays of every pixel, of a pinhole as of a camera with a lens. A pixel that no ray in front of
/// the camera reaches before the lens model folds over has a NaN ray. Throws DataError for invalid
/// intrinsics, and as RequireRays.
RayTable ComputeRays(const Intrinsics& intrinsics);

}  // namespace volalign

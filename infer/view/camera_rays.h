#pragma once

#include <Eigen/Core>

#include "core/camera.h"

namespace volalign {

/// Rays of every pixel, distortion included (0, 4, 5 or 8 of OpenCV's coefficients), inverted by
/// cv::undistortPoints. A pixel whose ray does not project back to it within 0.01 px (the lens
/// model folds over there) has a NaN ray. Throws DataError if more than half of the pixels have
/// none: the coefficients are wrong then.
RayTable ComputeRays(const Intrinsics& intrinsics);

/// Pixel of the normalised direction (x/z, y/z): OpenCV's closed-form model.
Eigen::Vector2d ProjectRay(const Intrinsics& intrinsics, const Eigen::Vector2d& ray);

}  // namespace volalign

#pragma once

// A strong lens, and its inverse by bisection: shares no code with the library.

#include <Eigen/Core>

#include "core/geometry/camera.h"

namespace volalign::testing_infer {

/// OpenCV's rational model with 8 coefficients, without the tangential ones, so that a pixel's ray
/// lies in the direction of the pixel from the principal point. The corners of the image are bent
/// inwards by a fifth.
inline Intrinsics StrongLens() {
  return {320, 288, 252.2, 252.2, 163.9, 168.2, {0.45, -0.02, 0, 0, -0.003, 0.68, 0.02, -0.005}};
}

/// Radius in the image, in focal lengths, of a ray at this radius on the plane z = 1.
inline double DistortedRadius(const Intrinsics& k, double r) {
  const auto& d = k.distortion;
  const double r2 = r * r, r4 = r2 * r2, r6 = r4 * r2;
  return r * (1 + d[0] * r2 + d[1] * r4 + d[4] * r6) / (1 + d[5] * r2 + d[6] * r4 + d[7] * r6);
}

/// Ray (x/z, y/z) of a pixel, for StrongLens.
inline Eigen::Vector2d RayThroughStrongLens(const Intrinsics& k, int u, int v) {
  Eigen::Vector2d pixel((u - k.cx) / k.fx, (v - k.cy) / k.fy);
  const double radius = pixel.norm();
  if (radius == 0) return pixel;
  double low = 0, high = 2;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (DistortedRadius(k, middle) < radius ? low : high) = middle;
  }
  return pixel * (low / radius);
}

}  // namespace volalign::testing_infer

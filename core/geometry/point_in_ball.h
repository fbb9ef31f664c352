#pragma once

#include <Eigen/Core>
#include <cmath>

#include "core/base/random.h"

namespace volalign {

/// Uniform in the ball of this radius about the origin, in the radius' unit.
inline Eigen::Vector3d PointInBall(double radius, RandomStream& random) {
  const double cos_polar = random.Uniform(-1, 1);
  const double azimuth = random.Uniform(0, 2 * M_PI);
  const double distance = radius * std::cbrt(random.Uniform());
  const double sin_polar = std::sqrt(1 - cos_polar * cos_polar);
  return distance *
         Eigen::Vector3d(sin_polar * std::cos(azimuth), cos_polar, sin_polar * std::sin(azimuth));
}

}  // namespace volalign

#pragma once

#include <Eigen/Core>
#include <cmath>

#include "core/base/portable_math.h"
#include "core/base/random.h"

namespace volalign {

/// Uniform in the ball of this radius about the origin, in the radius' unit.
inline Eigen::Vector3d PointInBall(double radius, RandomStream& random) {
  const double cos_polar = random.Uniform(-1, 1);
  const double azimuth = random.Uniform(0, 2 * M_PI);
  const double distance = radius * PortableCbrt(random.Uniform());
  const double sin_polar = std::sqrt(1 - cos_polar * cos_polar);
  const SinCos aside = PortableSinCos(azimuth);
  return distance * Eigen::Vector3d(sin_polar * aside.cos, cos_polar, sin_polar * aside.sin);
}

}  // namespace volalign

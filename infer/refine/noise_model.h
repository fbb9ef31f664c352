#pragma once

#include "core/geometry/sensor_kind.h"

namespace volalign::refine_internal {

/// Errors that a sensor's observations share, beyond its constant depth error.
struct NoiseModel {
  DepthErrorModel depth = ErrorsOf("");  ///< its smooth part and its corners are fitted
  double edge = 1;                       ///< scale of the silhouettes' standard deviations
  double line = 0;                       ///< m, of an edge's place if the boxes are fixed
};

}  // namespace volalign::refine_internal

#pragma once

#include "core/config/config_word.h"
#include "core/geometry/pose.h"

namespace volalign {

/// Kinds of worlds in which pose priors are given.
enum class PriorWorld {
  kStructure,  ///< it is the structure's frame in the first capture
  kMetric,     ///< it is in metres; the structure stands anywhere in it
  kScaleFree   ///< it has any scale; the structure stands anywhere in it
};
constexpr Words<PriorWorld, 3> WordsOf(PriorWorld) {
  return {{{"structure", PriorWorld::kStructure},
           {"metric", PriorWorld::kMetric},
           {"free", PriorWorld::kScaleFree}}};
}

/// A sensor's pose as known beforehand: from a CAD file, an earlier calibration or a robot.
struct PosePrior {
  Pose world_from_sensor = Pose::Identity();
  PriorWorld world = PriorWorld::kStructure;  ///< the same for all sensors
  /// Standard deviations of the sensor's position along each axis, in metres of the structure, and
  /// of its rotation about each axis.
  double sigma_m = 0, sigma_deg = 0;
};

}  // namespace volalign

#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A sensor whose pose is refuted by points beside the structure, its own and the others'.
struct FreeSpaceViolation {
  std::size_t other = 0;  ///< the sensor that shows it most clearly
  std::string name;       ///< of that sensor; for the caller to set
  /// Share of the surfaces of each other that the two could have seen and that one sees through.
  double share = 0;
  double log_odds = 0;  ///< natural logarithm, for its pose, by all its pairs
};

/// Judges sensors at their final poses. There is a result if the pairs of a sensor speak against it
/// with `refuting_odds`. The most doubtful sensor is taken out before the others are judged, so
/// that a single wrong one is named alone. If the others do not tell it from the sensor that shows
/// it most clearly, both are named, as of two sensors. `views`: null ones take no part. `poses`:
/// structure from sensor.
std::vector<std::optional<FreeSpaceViolation>> FindFreeSpaceViolations(
    const std::vector<const SensorView*>& views, const std::vector<Pose>& poses,
    const Structure& structure, double refuting_odds, int threads);

}  // namespace volalign

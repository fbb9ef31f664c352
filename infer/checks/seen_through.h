#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A sensor whose pose what it and the others measured beside the structure refutes.
struct SeenThrough {
  std::size_t other = 0;  ///< the sensor that shows it most clearly
  /// Of what the two could have seen of each other's surfaces, the share that one sees through.
  double share = 0;
  double log_odds = 0;  ///< natural logarithm, of its pose being right, by all its pairs
};

/// Of sensors at their final poses (structure from sensor; null views take no part): nothing where
/// no pair of a sensor speaks against it with odds of `refuting_odds`. The sensor that most speaks
/// against is taken out before the others are asked, so that one in a wrong place is named alone.
/// Where the others do not tell it from the one that shows it most clearly, as of two sensors, both
/// are named: either may be the one.
std::vector<std::optional<SeenThrough>> FindSeenThrough(const std::vector<const SensorView*>& views,
                                                        const std::vector<Pose>& poses,
                                                        const Structure& structure,
                                                        double refuting_odds, int threads);

}  // namespace volalign

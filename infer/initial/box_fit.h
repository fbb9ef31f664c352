#pragma once

#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/oriented_points.h"
#include "infer/view/alike.h"

namespace volalign {

/// Steps that bring points onto boxes, without labels.
struct BoxFit {
  int steps = 2 * kRounds;
  std::size_t points = kManyProbes;    ///< most points near the structure that are used
  double first_reach = kFarthestOff;   ///< m: farthest points in the first step
  double last_reach = 2 * kSamePlace;  ///< m: and in the last one
  /// Points of the floor beside the structure count too. The first steps need them, because few
  /// sides may lie near their points.
  bool floor = false;
};

/// Robust Gauss-Newton steps. Each point is drawn to the nearest finite side that faces as it does.
/// A point that lies beyond the side's border is drawn towards the border.
Pose FitToBoxes(const std::vector<OrientedPoint>& points, const Structure& structure,
                const BoxFit& fit, Pose structure_from_sensor);

}  // namespace volalign

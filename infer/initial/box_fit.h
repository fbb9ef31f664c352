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
  std::size_t points = kManyProbes;  ///< at most, of those near the structure
  double first_reach =
      kFarthestOff;  ///< m: points farther from the structure have no part in the first step
  double last_reach = 2 * kSamePlace;  ///< m: and in the last one
  /// Points of the floor beside the structure count, too: for the first steps, when few sides may
  /// have been brought onto their points.
  bool floor = false;
};

/// Robust Gauss-Newton steps: each point is drawn to the nearest of the finite sides that face as
/// it does; where it lies beyond the side's border, towards the border.
Pose FitToBoxes(const std::vector<OrientedPoint>& points, const Structure& structure,
                const BoxFit& fit, Pose structure_from_sensor);

}  // namespace volalign

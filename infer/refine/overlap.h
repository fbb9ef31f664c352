#pragma once

// The surfaces that two sensors both see. Not for callers of Refine.

#include <vector>

#include "core/geometry/structure.h"
#include "infer/refine/parameters.h"
#include "infer/refine/sensor_points.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

/// m: nearer to the structure, overlap repeats what the structure's own terms say.
inline constexpr double kOffStructure = 2 * kRoughPose;

/// At most `most` cloud points of a sensor at `structure_from_sensor`, to be matched with those of
/// other sensors. Half of them are near the structure, the rest farther away. Unless `all`, points
/// nearer to the structure than kOffStructure are then left out.
std::vector<int> ChooseOverlapPoints(const Structure& structure, const SensorPoints& points,
                                     const Pose& structure_from_sensor, int most, bool all);

/// One sensor as others see it.
struct OverlapEnd {
  const SensorPoints* points;
  const std::vector<int>* chosen;  ///< indices into the cloud
  FrameState state;

  const CloudPoint& Cloud(int i) const {
    return points->cloud.points()[static_cast<std::size_t>(i)];
  }
};

/// Two cloud points of the same surface.
struct Match {
  int from, to;     ///< indices into the clouds
  double residual;  ///< m, signed distance of `from` to the plane at `to`
};

/// Fewest matches from which two sensors' overlap, or its spread, can be estimated.
inline constexpr std::size_t kFewestMatches = 20;

/// Which of a's chosen points b sees: b's nearest cloud point lies within `gate`, m, and faces the
/// same way.
std::vector<Match> FindMatches(const OverlapEnd& a, const OverlapEnd& b, double gate,
                               double min_cosine);

/// The points of two sensors that the other one sees.
struct SharedPoints {
  std::vector<Match> of_a, of_b;  ///< a's chosen points that b sees, and b's that a sees
  double overlap = 0;             ///< share of the chosen points of both

  /// Are the two a pair: at least `min_overlap`, and kFewestMatches?
  bool IsPair(double min_overlap) const {
    return of_a.size() + of_b.size() >= kFewestMatches && overlap >= min_overlap;
  }
  double rms() const;  ///< m, point to plane over all of them
};
SharedPoints FindShared(const OverlapEnd& a, const OverlapEnd& b, double gate, double min_cosine);

}  // namespace volalign::refine_internal

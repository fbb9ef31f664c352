#pragma once

// What two sensors see of the same surfaces. Not for callers of Refine.

#include <vector>

#include "core/structure.h"
#include "infer/refine/parameters.h"
#include "infer/refine/sensor_points.h"

namespace volalign::refine_internal {

/// At most `most` cloud points of a sensor at `structure_from_sensor` to be matched with the other
/// sensors': seven of ten from around the structure, the rest from farther away.
std::vector<int> ChooseOverlapPoints(const Structure& structure, const SensorPoints& points,
                                     const Pose& structure_from_sensor, int most);

/// One sensor as others see it.
struct OverlapView {
  const SensorPoints* points;
  const std::vector<int>* chosen;  ///< indices into the cloud
  SensorState state;

  const CloudPoint& Cloud(int i) const { return points->cloud()[static_cast<std::size_t>(i)]; }
};

/// Two cloud points of the same surface.
struct Match {
  int from, to;     ///< indices into the clouds
  double residual;  ///< m, signed distance of `from` to the plane at `to`
};

/// Fewest matches from which two sensors' overlap, or its spread, can be told.
inline constexpr std::size_t kFewestMatches = 20;

/// Does another sensor see enough of what one offers, for the two to be a pair: at least
/// `min_overlap` of its chosen points, and kFewestMatches?
bool SeeEnough(std::size_t matches, const OverlapView& from, double min_overlap);

/// Which of a's chosen points b sees: the nearest cloud point of b's lies within `gate`, m, and
/// faces the same way.
std::vector<Match> FindMatches(const OverlapView& a, const OverlapView& b, double gate,
                               double min_cosine);

/// An edge of the overlap graph.
struct Pair {
  int a, b;        ///< indices of the sensors, a < b
  double overlap;  ///< share of the chosen points, of both, that the other one sees too
  double rms;      ///< m, point to plane over them
};

/// Pairs of sensors of which at least `min_overlap` of the chosen points match.
std::vector<Pair> FindPairs(const std::vector<OverlapView>& views, double gate, double min_cosine,
                            double min_overlap);

}  // namespace volalign::refine_internal

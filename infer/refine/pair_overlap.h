#pragma once

// What frames measured of the same surfaces. Not for callers of Refine.

#include <cstddef>
#include <vector>

#include "infer/refine/frame_observations.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// A point of one frame, and what the other one measured of the same surface.
struct PairMatch {
  const CloudPoint *point, *plane;
  double sigma;     ///< m, standard deviation of the distance between the two
  double residual;  ///< m, that distance, signed
  double bounced_point = 0, bounced_plane = 0;  ///< of both, see BouncedShare
};

/// What two frames measured of the same surfaces and the structure does not say already.
struct PairOverlap {
  std::size_t a = 0, b = 0;
  std::vector<PairMatch> of_a = {}, of_b = {};  ///< a's points that b sees, and b's that a sees
  double cells = 0;   ///< how many independent measurements all of them are
  double excess = 1;  ///< their spread in sigmas, at least 1
};

/// Of the pairs of frames that count, as they lie at `state`, but for those that the structure
/// holds and of which one is `held`.
std::vector<PairOverlap> FindOverlaps(const JointProblem& problem,
                                      const std::vector<FrameObservations>& observed,
                                      const std::vector<char>& held, const State& state);

}  // namespace volalign::refine_internal

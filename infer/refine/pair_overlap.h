#pragma once

// Surfaces that two frames both measured. Not for callers of Refine.

#include <cstddef>
#include <vector>

#include "infer/refine/frame_observations.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// A point of one frame, and the other frame's measurement of the same surface.
struct PairMatch {
  const CloudPoint *point, *plane;
  double sigma;     ///< m, standard deviation of the distance between the two
  double residual;  ///< m, that distance, signed
  double multipath_point = 0, multipath_plane = 0;  ///< of both, see DiffuseMultipathShare
};

/// Measurements of the same surfaces by two frames, away from the structure.
struct PairOverlap {
  std::size_t a = 0, b = 0;
  std::vector<PairMatch> of_a = {}, of_b = {};  ///< a's points that b sees, and b's that a sees
  double cells = 0;                             ///< number of independent measurements
  double excess = 1;                            ///< their spread in sigmas, at least 1
};

/// Standard deviation, m, of what a sensor's smooth depth error and errors of its intrinsics add to
/// the distance of a cloud point p from a surface. Sensor frame.
double PointSigma(const DepthErrorModel& errors, const Eigen::Vector3d& p);

/// The overlaps of all pairs of frames that count (JointProblem::OverlapCounts), at `state`. Pairs
/// with a fixed frame do not count.
std::vector<PairOverlap> FindOverlaps(const JointProblem& problem,
                                      const std::vector<FrameObservations>& observed,
                                      const std::vector<char>& fixed, const State& state);

}  // namespace volalign::refine_internal

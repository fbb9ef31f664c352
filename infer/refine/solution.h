#pragma once

// The refinement: all parameters, as a statistical model. Not for callers of Refine.

#include <optional>
#include <vector>

#include "infer/refine/frame_observations.h"
#include "infer/refine/pair_overlap.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// m, standard deviation: how far a real box's edges deviate from the structure, beyond its faces,
/// if boxes are fixed. On three real captures it was 10-30 mm for faces that fit to 4 mm.
inline constexpr double kHeldEdge = 0.012;

/// Standard deviation of an edge's place in the refinement (NoiseModel::line), given what is free.
/// 0 if boxes are free, else kHeldEdge.
double LineTolerance(const FreeSet& free);

/// Each sensor's observations at `state`, with the noise model that explains them best. Sensors
/// without structure terms have none. If observations are too few, the noise models of `previous`
/// stay, or, if that is empty, those usual for the sensor's kind.
std::vector<FrameObservations> GatherObservations(const JointProblem& problem, const State& state,
                                                  const FreeSet& free,
                                                  std::vector<FrameObservations> previous);

/// Values of all parameters, and their observations.
struct Solution {
  FreeSet free;
  State state;
  std::vector<FrameObservations> observed;
  /// Frames that are fixed and have no terms.
  std::vector<char> fixed;
  std::vector<PairOverlap> overlaps = {};  ///< at the start of the last Solve
};

/// Sets the observations' covariances for this tolerance of edges, at the solution's poses.
void SetLineTolerance(const JointProblem& problem, double tolerance, Solution* solution);

/// Does a frame of a capture that is not fixed see a side of a box?
bool IsSeen(const JointProblem& problem, const Solution& solution, std::size_t capture, int box);

/// Finds overlaps and moves all free parameters to their most probable values. Returns false, and
/// moves nothing, if they cannot be computed.
bool Solve(const JointProblem& problem, Solution* solution);

/// Fixes the gauge: no measurement shows whether all boxes move as one, and everything with them.
/// Makes the mean displacement of the boxes zero in each capture. The priors nearly do so already.
/// Poses and placements move with the boxes: a sensor keeps its place among the boxes and the other
/// sensors. Fixed frames do not move.
void CentreBoxes(const JointProblem& problem, Solution* solution);

/// Can a frame be part of a solution: are its pose, its residuals and their covariance finite?
bool IsUsable(const JointProblem& problem, const Solution& solution, std::size_t frame);

/// Fixes a frame at its start with a depth offset of 0. Its sensor has no errors then, unless it
/// has a free frame.
void HoldFrame(const JointProblem& problem, std::size_t frame, Solution* solution);

/// Gathers observations and solves, RefineOptions::associations times, from `solution.state` on.
/// Frames that are not usable are fixed at their starts. If the problem cannot be solved even then,
/// all frames are.
Solution AssociateAndSolve(const JointProblem& problem, Solution solution);

}  // namespace volalign::refine_internal

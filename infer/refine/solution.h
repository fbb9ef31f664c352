#pragma once

// The refinement: all parameters, as a statistical model. Not for callers of Refine.

#include <optional>
#include <vector>

#include "infer/refine/frame_observations.h"
#include "infer/refine/pair_overlap.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// m, standard deviation: how far a real box's edges stray from where the structure has them,
/// beyond what its faces do, where nothing tells where boxes stand. On three real captures it was
/// 10-30 mm for faces that fit to 4 mm.
inline constexpr double kHeldEdge = 0.012;

/// Standard deviation of an edge's place in the refinement (NoiseModel::line), given what is free:
/// an edge of a box that is held where the structure has it strays as its faces do.
double LineTolerance(const FreeSet& free);

/// Each sensor's observations as they lie at `state`, with the noise model that explains them best.
/// Of sensors without structure terms: none. Where observations are too few to tell, the noise
/// models of `previous` are kept or, that being empty, what is usual for the sensor's kind.
std::vector<FrameObservations> GatherObservations(const JointProblem& problem, const State& state,
                                                  const FreeSet& free,
                                                  std::vector<FrameObservations> previous);

/// Values of all parameters, and what they rest on.
struct Solution {
  FreeSet free;
  State state;
  std::vector<FrameObservations> observed;
  /// Frames that stay where they are and say nothing.
  std::vector<char> held;
  std::vector<PairOverlap> overlaps = {};  ///< where the last Solve began
};

/// Sets the observations' covariances for this tolerance of edges, at the solution's poses.
void SetLineTolerance(const JointProblem& problem, double tolerance, Solution* solution);

/// Does a frame of a still, other than those that are held, see a side of a box?
bool IsSeen(const JointProblem& problem, const Solution& solution, std::size_t still, int box);

/// Finds what overlaps, and moves what is free to its most probable values. False, and nothing is
/// moved, if they cannot be computed.
bool Solve(const JointProblem& problem, Solution* solution);

/// Can a frame be part of a solution: are its pose, its residuals and their covariance finite?
bool IsUsable(const JointProblem& problem, const Solution& solution, std::size_t frame);

/// Puts a frame where it starts, to stay there.
void HoldFrame(const JointProblem& problem, std::size_t frame, Solution* solution);

/// From `solution.state` on, RefineSchedule::associations times: gathers observations and
/// solves. Frames that are not usable are held where they start; all of them where even that does
/// not make the problem solvable.
Solution AssociateAndSolve(const JointProblem& problem, Solution solution);

}  // namespace volalign::refine_internal

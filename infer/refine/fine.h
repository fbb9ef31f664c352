#pragma once

// The fine stage: all parameters, as a statistical model. Not for callers of Refine.

#include <optional>
#include <vector>

#include "infer/refine/evidence.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// Standard deviation of an edge's place in the fine stage (NoiseModel::line), given what is free:
/// an edge of a box that is held where the structure has it strays as its faces do.
double LineTolerance(const FreeSet& free);

/// Each sensor's observations as they lie at `state`, with the noise model that explains them best.
/// Of sensors without structure terms: none. `previous`, of which the noise models are kept where
/// observations are too few to tell, may be empty.
std::vector<SensorEvidence> GatherEvidence(const JointProblem& problem, const State& state,
                                           const FreeSet& free,
                                           std::vector<SensorEvidence> previous);

/// Fits the evidence's covariances to what is free now, at the poses of `state`.
void UpdateLineTolerance(const JointProblem& problem, const State& state, const FreeSet& free,
                         std::vector<SensorEvidence>* evidence);

/// Values of all parameters, and what they rest on.
struct Solution {
  FreeSet free;
  State state;
  std::vector<SensorEvidence> evidence;
  /// Frames that stay at their fallbacks: there is no better pose of them.
  std::vector<char> kept_initial;
};

/// Does a frame of a still, other than those at their fallbacks, see a side of a box?
bool IsSeen(const JointProblem& problem, const Solution& solution, std::size_t still, int box);

/// The most probable values of what is free, from those of `solution` on; nothing if they cannot be
/// computed.
std::optional<State> SolveFine(const JointProblem& problem, const Solution& solution);

/// Can a frame be part of a solution: are its pose, its residuals and their covariance finite?
bool IsUsable(const JointProblem& problem, const Solution& solution, std::size_t frame);

/// Puts a frame at its fallback pose, to stay there.
void KeepInitial(const JointProblem& problem, std::size_t frame, Solution* solution);

/// From `solution.state` on, options.fine_iterations times: gathers evidence and solves. Frames
/// that are not usable are kept at their fallbacks and say nothing; all of them where even that
/// does not make the problem solvable.
Solution IterateFine(const JointProblem& problem, Solution solution);

}  // namespace volalign::refine_internal

#pragma once

// The fine stage: all parameters, as a statistical model. Not for callers of Refine.

#include <vector>

#include "infer/refine/association.h"
#include "infer/refine/evidence.h"
#include "infer/refine/problem.h"
#include "infer/refine/solver.h"

namespace volalign::refine_internal {

/// Gates of the fine stage's associations, and of pairs. Overlap that the structure does not hold
/// may be farther apart, see fine.cc.
Gates FineGates();

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

/// The problem over all parameters; it refers to all its arguments. Those of which `constant` is
/// set (see ParameterLayout::Constant) stay as they are. A sensor of which even the pose is
/// constant has no terms of its own. `kept_initial`: sensors whose overlap with others no longer
/// counts.
CeresProblem BuildFineProblem(const JointProblem& problem,
                              const std::vector<SensorEvidence>& evidence,
                              const std::vector<char>& kept_initial,
                              const std::vector<char>& constant, State* state);

/// The most probable values of what is free, from `state` on.
State SolveFine(const JointProblem& problem, const std::vector<SensorEvidence>& evidence,
                const std::vector<char>& kept_initial, const FreeSet& free, State state);

}  // namespace volalign::refine_internal

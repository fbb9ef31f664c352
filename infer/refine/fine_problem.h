#pragma once

// The refinement's terms as a problem for Ceres. Not for callers of Refine.

#include <Eigen/Core>
#include <vector>

#include "infer/refine/association.h"
#include "infer/refine/frame_observations.h"
#include "infer/refine/problem.h"
#include "infer/refine/solver.h"

namespace volalign::refine_internal {

/// Gates of the refinement's associations, and of pairs. Overlap that the structure does not hold
/// may be farther apart, see fine_problem.cc.
Gates FineGates();

/// Prior standard deviations of all parameters, under the noise models of `observed`, as the
/// options have them.
Eigen::VectorXd PriorSigmas(const JointProblem& problem,
                            const std::vector<FrameObservations>& observed);

/// The problem over all parameters; it refers to all its arguments. Those of which `constant` is
/// set (see ParameterLayout::Constant) stay as they are. A sensor of which even the pose is
/// constant has no terms of its own. `held`: sensors whose overlap with others no longer
/// counts.
CeresProblem BuildFineProblem(const JointProblem& problem,
                              const std::vector<FrameObservations>& observed,
                              const std::vector<char>& held, const std::vector<char>& constant,
                              State* state);

}  // namespace volalign::refine_internal

#pragma once

// The result of a refinement, from its solution and posterior. Not for callers of Refine.

#include <cstddef>
#include <vector>

#include "infer/refine/disagreement.h"
#include "infer/refine/posterior.h"
#include "infer/refine/problem.h"
#include "infer/refine/refine.h"

namespace volalign::refine_internal {

/// The result without covariances, sigmas and pairs.
RefineResult MakeResult(const JointProblem& problem, const Agreed& agreed);

/// Adds covariances, sigmas and pairs. `unsolved`: frames whose part of the problem could not be
/// solved.
void AddUncertainties(const JointProblem& problem, const Agreed& agreed,
                      const std::vector<char>& unsolved, const Posterior& posterior,
                      RefineResult* result);

}  // namespace volalign::refine_internal

#pragma once

// What a refinement gives, from its solution and posterior. Not for callers of Refine.

#include <cstddef>
#include <vector>

#include "infer/refine/disagreement.h"
#include "infer/refine/posterior.h"
#include "infer/refine/problem.h"
#include "infer/refine/refine.h"

namespace volalign::refine_internal {

/// Without covariances, sigmas and pairs. `given_lenses`: how many of the problem's lenses the
/// caller gave.
RefineResult MakeResult(const JointProblem& problem, const Agreed& agreed,
                        std::size_t given_lenses);

/// Adds those. `unsolved`: frames whose part of the problem could not be solved.
void AddUncertainties(const JointProblem& problem, const Agreed& agreed,
                      const std::vector<char>& unsolved, const Posterior& posterior,
                      RefineResult* result);

}  // namespace volalign::refine_internal

#pragma once

// What a refinement gives, from its solution and posterior. Not for callers of Refine.

#include <cstddef>
#include <optional>
#include <vector>

#include "infer/refine/acceptance.h"
#include "infer/refine/disagreement.h"
#include "infer/refine/posterior.h"
#include "infer/refine/problem.h"
#include "infer/refine/refine.h"

namespace volalign::refine_internal {

/// `unsolved`: frames whose part of the problem could not be solved. `set_aside`: those that were,
/// of all. `given_lenses`: how many of the problem's lenses the caller gave.
RefineResult MakeResult(const JointProblem& problem, const Acceptance& accepted,
                        const std::vector<char>& unsolved, const Posterior& posterior,
                        const std::vector<std::optional<SetAside>>& set_aside,
                        std::size_t given_lenses);

}  // namespace volalign::refine_internal

#pragma once

// What no measurement tells: all boxes may move as one, and everything with them. Not for callers
// of Refine.

#include "infer/refine/problem.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// Makes the mean displacement of the boxes zero in each still, which the priors all but see to.
/// Poses and placements go with the boxes: every sensor stays where it is among the boxes that are
/// seen and the other sensors, except those that are held.
void CentreBoxes(const JointProblem& problem, Solution* solution);

}  // namespace volalign::refine_internal

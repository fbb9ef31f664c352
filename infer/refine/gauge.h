#pragma once

// The gauge: no measurement shows whether all boxes move as one, and everything with them. Not for
// callers of Refine.

#include "infer/refine/problem.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// Makes the mean displacement of the boxes zero in each capture. The priors nearly do so already.
/// Poses and placements move with the boxes: a sensor keeps its place among the boxes and the other
/// sensors. Fixed frames do not move.
void CentreBoxes(const JointProblem& problem, Solution* solution);

}  // namespace volalign::refine_internal

#pragma once

// The coarse stage: from far off to where correspondences are right. Not for callers of Refine.

#include <vector>

#include "infer/refine/association.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// Gates of the coarse stage's associations, tightening from one to the next.
Gates CoarseGates(int iteration);

/// Moves the poses alone: labelled points to the finite rectangles of their sides (infinite planes
/// would let a sensor that sees parallel sides slide), silhouettes to edge lines, and symmetric
/// point-to-plane terms between sensors that see the same surfaces, under Cauchy's loss.
/// Correspondences are renewed before each of RefineSchedule::outer_iterations solutions. Sensors
/// marked in `held` stay where they are and hold the others by overlap alone.
State SolveCoarse(const JointProblem& problem, const std::vector<char>& held, State state);

}  // namespace volalign::refine_internal

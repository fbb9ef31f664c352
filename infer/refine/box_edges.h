#pragma once

// Is one box another than described? Not for callers of Refine.

#include <optional>

#include "infer/refine/problem.h"
#include "infer/refine/refine.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// The structure with one edge of a box longer by `change`, m; `axis`: of the box's own frame. A
/// box that is higher lifts what rests on it, one that is wider or deeper keeps its middle. The
/// change may be negative, but not shorten the edge below kShortestEdge (DataError).
Structure WithEdge(const Structure& structure, int box, int axis, double change);

/// The edge of a single box whose wrong length explains the measurements best, with all boxes'
/// common size as described, by a quadratic approximation about the solution. `solution`: with all
/// frames that take part. Nothing where it cannot be computed.
std::optional<RefinedEdge> LikeliestEdge(const JointProblem& problem, const Solution& solution);

}  // namespace volalign::refine_internal

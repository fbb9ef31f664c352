#pragma once

// Is the length of one box's edge described wrongly? Not for callers of Refine.

#include <optional>

#include "infer/refine/problem.h"
#include "infer/refine/refine.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// The structure with one edge of a box longer by `change`, m. `axis` is an axis of the box's own
/// frame. A higher box lifts what rests on it. A wider or deeper box keeps its middle. `change` may
/// be negative. Throws DataError if the edge becomes shorter than kShortestEdge.
Structure WithEdge(const Structure& structure, int box, int axis, double change);

/// The edge of a single box whose wrong length explains the measurements best. The size that all
/// boxes share is then as described. It is a quadratic approximation about `solution`, in which all
/// frames take part. Nothing if it cannot be computed.
std::optional<RefinedEdge> LikeliestEdge(const JointProblem& problem, const Solution& solution);

}  // namespace volalign::refine_internal

#pragma once

#include "infer/checks/placement.h"
#include "infer/view/frames.h"

namespace volalign {

/// Locates frames that failed as degenerate_sides by what they share with those of their still that
/// are located.
///
/// Such a frame's pose is open along some directions, or only one side of it is known. Candidates
/// are made along these directions from the initial pose, or from the largest sides and the way in
/// which the other sensors are mounted. They are ranked by how much of what the frame measured lies
/// on what its neighbours measured, less what lies where one of the two sees through. The best are
/// refined together with the located frames, by structure and overlap. The frame is located where
/// one of them explains its view of the structure, is not refuted by what its neighbours measured
/// beside it (options.verdict.refuting_odds), is known to
/// options.verdict.max_sigma_by_neighbours_*, and no other candidate does about as well.
/// LocatedFrame::by_neighbours then says so; a frame that is not located keeps its finding. One
/// that rests on an ambiguous neighbour is ambiguous, too: it would follow it.
PerFrame<LocateResult> LocateByNeighbours(const Seen& seen, PerFrame<LocateResult> results,
                                          const LocateOptions& options);

}  // namespace volalign

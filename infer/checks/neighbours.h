#pragma once

#include "infer/checks/placement.h"
#include "infer/view/frames.h"

namespace volalign {

/// Locates frames that failed as degenerate_sides by the surfaces that they share with located
/// frames of their capture.
///
/// Such a frame's pose is open along some directions, or only one of its sides is known. Candidates
/// lie along these directions from the initial pose, or from the largest sides and the way in which
/// the other sensors are mounted. Candidates that bring most points onto the neighbours' points are
/// refined together with the located frames, by structure and overlap. The frame is located at a
/// candidate that explains its view of the structure and is known to 3 cm and 2 deg. It also has to
/// be more probable than not by the points beside the structure (LogOddsOfPairs), and no other pose
/// may meet these conditions. LocatedFrame::by_neighbours then says so; a frame that is not located
/// keeps its finding. A frame that rests on an ambiguous neighbour is ambiguous too, because it
/// would follow it.
PerFrame<LocateResult> LocateByNeighbours(const Seen& seen, PerFrame<LocateResult> results,
                                          const LocateOptions& options);

}  // namespace volalign

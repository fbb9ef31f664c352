#pragma once

#include "infer/checks/placement.h"
#include "infer/view/frames.h"

namespace volalign {

/// Locates frames that failed as degenerate_sides by what they share with those of their still that
/// are located.
///
/// Such a frame's pose is open along some directions, or only one side of it is known. Candidates
/// are made along these directions from the initial pose, or from the largest sides and the way in
/// which the other sensors are mounted. Those at which the largest part of what the frame measured
/// lies on what its neighbours measured are refined together with the located frames, by structure
/// and overlap. The frame is located where one of them explains its view of the structure, is more
/// probable than not by what sensors measured beside it (LogOddsOfPairs), is known to 3 cm and 2
/// deg, and no other pose meets these conditions. LocatedFrame::by_neighbours then says so; a frame
/// that is not located keeps its finding. One that rests on an ambiguous neighbour is ambiguous,
/// too: it would follow it.
PerFrame<LocateResult> LocateByNeighbours(const Seen& seen, PerFrame<LocateResult> results,
                                          const LocateOptions& options);

}  // namespace volalign

#pragma once

#include <vector>

#include "core/geometry/pose.h"
#include "infer/checks/placement.h"
#include "infer/view/frames.h"

namespace volalign {

/// Where the stack stood in each still.
struct Stood {
  std::vector<Pose> first_from_stack;  ///< of each still, the first the identity
  SomeFrames<Finding> contradicted;    ///< located frames that contradict it
};

/// Finds out where the stack stood in each still, approximately, by the sensors that are located
/// in several. A sensor stands in one place in all stills: most sensors of a still, weighed by how
/// well they fit to the stack, decide where the stack stood, and most stills of a sensor where it
/// stands. A frame that says otherwise contradicts that (disagrees), as does one of a still that no
/// chain of sensors joins to the first (unconnected; its stack is taken to stand where it first
/// did).
Stood JoinStills(const Seen& seen, const PerFrame<LocateResult>& results);

}  // namespace volalign

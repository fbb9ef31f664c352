#pragma once

#include <vector>

#include "core/geometry/pose.h"
#include "infer/checks/placement.h"
#include "infer/view/frames.h"

namespace volalign {

/// The stack's poses in the captures.
struct Stood {
  std::vector<Pose> first_from_stack;  ///< for each capture; the first is the identity
  SomeFrames<Finding> contradicted;    ///< located frames that contradict these poses
};

/// Finds approximately where the stack stood in each capture, by the sensors that are located in
/// several. A sensor stands in one place in all captures. Most sensors of a capture decide where
/// the stack stood, and most captures of a sensor where the sensor stands. A doubtful pose counts
/// half. A frame that says otherwise contradicts that (disagrees). So does a frame of a capture
/// that no chain of sensors joins to the first (unconnected). Its stack is assumed to stand where
/// it first did.
Stood JoinCaptures(const Seen& seen, const PerFrame<LocateResult>& results);

}  // namespace volalign

#pragma once

// The frames of a planned rig's sensors, as far as they are known without a picture of the room:
// the stack and the floor.

#include <cstdint>
#include <string>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

struct PlannedFrame {
  SensorFrame frame;
  LabelImage labels;  ///< true labels
};

/// The stack as described, on its floor, seen with errors of the frame's kind (ErrorsOf). They are
/// drawn from `seed`: white, smooth, offset and gaps at depth edges. `frame` has name, kind,
/// intrinsics and pose (ground_truth).
PlannedFrame MeasurePlanned(SensorFrame frame, const Structure& structure, std::uint64_t seed,
                            std::uint64_t index);

}  // namespace volalign

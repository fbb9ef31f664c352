#pragma once

#include <string>

#include "core/geometry/depth_error_model.h"

namespace volalign {

/// The depth errors that calibration assumes of a frame before it fits them. They are those of the
/// sensor's kind (a name of the intrinsics pool, see SensorFrame::sensor), but with the smooth part
/// of an unknown kind. A D415 has twice that smooth error, growing with the square of the depth.
/// But with its own values, eight stereo cameras of a rig from another simulator were 3.1 mm off in
/// the median instead of 2.5 mm.
DepthErrorModel PriorErrorsOf(const std::string& sensor);

}  // namespace volalign

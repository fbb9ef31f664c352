#pragma once

#include <string>

#include "core/geometry/depth_error_model.h"

namespace volalign {

/// What calibration assumes of a frame's depths before it has fitted their errors: those of the
/// sensor's kind (a name of the intrinsics pool, see SensorFrame::sensor), with the smooth part of
/// a kind that is not known. A frame of a D415 has twice that smooth error, growing with the square
/// of the depth; to begin with that much puts eight stereo cameras of a rig from another simulator
/// 3.1 mm off in the median instead of 2.5 mm.
DepthErrorModel PriorErrorsOf(const std::string& sensor);

}  // namespace volalign

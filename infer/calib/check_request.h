#pragma once

#include <vector>

#include "core/geometry/structure.h"
#include "infer/calib/calibrate.h"
#include "infer/view/frames.h"

namespace volalign {

/// What is to be calibrated. Throws ConfigError or DataError for what no stage of Calibrate could
/// make sense of. `model`: there is a network.
CaptureSet CheckRequest(std::vector<Still> stills, Structure structure,
                        const CalibrateOptions& options, bool model);

}  // namespace volalign

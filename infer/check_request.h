#pragma once

#include <vector>

#include "infer/calibrate.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// Throws ConfigError or DataError for what no stage of Calibrate could make sense of. `model`:
/// there is a network.
void CheckRequest(const std::vector<Still>& stills, const CalibrateOptions& options, bool model);

}  // namespace volalign

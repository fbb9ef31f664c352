#pragma once

#include <vector>

#include "infer/calibrate.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// Throws ConfigError or DataError for what no stage of Calibrate could make sense of.
void CheckRequest(const std::vector<Still>& stills, const CalibrateOptions& options);

}  // namespace volalign

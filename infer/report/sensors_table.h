#pragma once

#include <vector>

#include "core/json/table.h"
#include "infer/calib/result.h"

namespace volalign {

/// The table of FormatReport: one row per sensor, with code, reason and hint of those that are not
/// ok.
Table SensorsTable(const std::vector<FrameResult>& sensors);

}  // namespace volalign

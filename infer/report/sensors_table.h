#pragma once

#include <vector>

#include "core/json/table.h"
#include "infer/calib/result.h"

namespace volalign {

/// The sensors as the table of FormatReport has them, one row each; with code, reason and hint of
/// those that are not ok.
Table SensorsTable(const std::vector<FrameResult>& sensors);

}  // namespace volalign

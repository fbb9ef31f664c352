#pragma once

#include <string>

#include "infer/calib/result.h"

namespace volalign {

/// The verdict, reasons and hints of sensors that are not ok, a table of sensors (status, sides,
/// RMS, standard deviations, errors where there is a ground truth) with a line that says what its
/// columns are, the boxes as they were found, the overlap of each two sensors, and d1 and d2; for a
/// terminal.
std::string FormatReport(const CalibrationResult& result);

/// Its sentences on what was found beside the poses, a line each: both poses of sensors that
/// disagree with the others, where several stills' stacks stood, lenses that are not those given.
std::string FormatNotes(const CalibrationResult& result);

}  // namespace volalign

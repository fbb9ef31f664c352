#pragma once

#include <string>

#include "infer/result.h"

namespace volalign {

/// Table of sensors (status, sides, RMS, standard deviations, errors where there is a ground
/// truth) with a line that says what its columns are, reasons and hints of those that are not ok,
/// the boxes as they were found, the overlap of each two sensors, d1 and d2, and a verdict; for a
/// terminal.
std::string FormatReport(const CalibrationResult& result);

/// Its sentences on what was found beside the poses, a line each: where several stills' stacks
/// stood, boxes off their places, lenses that are not those given, both poses of sensors that
/// disagree with the others.
std::string FormatNotes(const CalibrationResult& result);

}  // namespace volalign

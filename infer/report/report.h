#pragma once

#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "infer/calib/result.h"

namespace volalign {

/// The result as text for a terminal. It has the verdict, and reasons and hints of sensors that are
/// not ok. A table of sensors follows (status, sides, RMS, standard deviations, errors if there is
/// a ground truth), with a line on its columns. Then come the boxes as found, the pairs of sensors,
/// and d1 and d2.
std::string FormatReport(const CalibrationResult& result);

/// Its sentences beside the poses, a line each: both poses of sensors that disagree with the
/// others, the stack's place in each of several captures, and changed lenses.
std::string FormatNotes(const CalibrationResult& result);

/// Returns the next steps, a sentence each; also if every sensor is ok.
std::vector<std::string> Advise(const CalibrationResult& result);

}  // namespace volalign

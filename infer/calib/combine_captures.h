#pragma once

#include <vector>

#include "infer/calib/joint_solution.h"
#include "infer/calib/result.h"
#include "infer/view/frames.h"

namespace volalign {

/// Combines the captures' results, without the size, the solution's report and the timings. Sensors
/// are in the order of CaptureSet::sensors, with poses in the first capture's structure and without
/// images. A sensor gets the status of the capture in which it is placed best. A finding about the
/// sensor itself, not about its view in one capture, counts in any case.
CalibrationResult CombineCaptures(const CaptureSet& input, std::vector<CaptureResult> captures,
                                  const SomeFrames<FrameSolution>& frames);

}  // namespace volalign

#pragma once

#include <functional>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/calib/calibrate.h"

namespace volalign {

/// What calibrates other stills in the same way.
using Recalibrate = std::function<CalibrationResult(const std::vector<Still>&)>;

/// Where a result is bad, tries what people do wrong with captures, and says what it was. `result`
/// is that of `stills`; its poses stay.
/// - Depths in another unit, where frames are in no unit of a room or no sensor is placed: the
///   factor at which geometry finds the structure, and with which a calibration places most
///   sensors (depth_scale).
/// - Two exchanged depth files, where sensors are apart, disagree or have suspect intrinsics:
///   exchanged back, fewer are in doubt, and the mean square of the distances between sensors'
///   points is at most half (files_exchanged).
/// - Intrinsics that a sensor of the stated kind does not have, where a sensor is not ok: the
///   sensor's first suspicion (intrinsics_suspect); and where most sensors have wrong ones, every
///   placed sensor's.
/// - Frames whose pixels have nothing in common with their neighbours, where a sensor is not ok.
void TryHypotheses(const std::vector<Still>& stills, const Structure& structure,
                   const CalibrateOptions& options, const Recalibrate& recalibrate,
                   CalibrationResult* result);

}  // namespace volalign

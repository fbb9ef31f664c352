#pragma once

#include <functional>

#include "core/geometry/structure.h"
#include "infer/calib/calibrate.h"

namespace volalign {

/// Calibrates another capture in the same way.
using Recalibrate = std::function<CalibrationResult(const Capture&)>;

/// Tries usual mistakes with captures where a result is bad, and adds findings and hints to
/// `result`. Its poses do not change. `result` is the calibration of `first` and of any further
/// captures. A mistake is tried with `first` alone, since all captures of a rig have it.
/// If depths are in no unit of a room or no sensor is placed, depths may be in another unit
/// (depth_scale). Geometry then finds the structure at a factor with which a calibration places at
/// least half of these sensors.
/// If sensors are apart, disagree or have suspect intrinsics, two depth files may be exchanged
/// (files_exchanged). Exchanged back, fewer sensors are in doubt, and the mean square of the
/// distances between sensors' points is less than half.
/// Intrinsics may be those of the stated kind at another image size (intrinsics_suspect). For a
/// sensor that is not ok they may also be none of the kind's. If most sensors have suspect ones,
/// every placed sensor does. A sensor that is not ok gets a hint if its pixels have nothing in
/// common with their neighbours, or a filter filled its holes.
void TryHypotheses(const Capture& first, const Structure& structure,
                   const CalibrateOptions& options, const Recalibrate& recalibrate,
                   CalibrationResult* result);

}  // namespace volalign

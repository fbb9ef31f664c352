#pragma once

#include <vector>

#include "infer/calib/calibrate.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::testing_infer {

/// Of a RealSense D415, 320x180.
inline Intrinsics WideIntrinsics() { return {320, 180, 235.9, 235.9, 159.3, 88.0, {}}; }

/// Calibrates what the rig's frames show, with its labels.
inline CalibrationResult CalibrateRig(const Rig& rig, const CalibrateOptions& options = {}) {
  StoredSegmenter segmenter = rig.PerfectSegmenter();
  return Calibrate(rig.frames, rig.structure, segmenter, options);
}

/// The same by the structure's shape alone, without a network.
inline CalibrationResult CalibrateByShape(const std::vector<SensorFrame>& frames,
                                          const Structure& structure,
                                          const CalibrateOptions& options = {}) {
  return Calibrate(std::vector<Capture>{{"", frames}}, structure, nullptr, options);
}

}  // namespace volalign::testing_infer

#pragma once

#include "infer/calib/calibrate.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::testing_infer {

/// Of a RealSense D415, 320x180.
inline Intrinsics WideIntrinsics() {
  Intrinsics wide;
  wide.width = 320;
  wide.height = 180;
  wide.fx = wide.fy = 235.9;
  wide.cx = 159.3;
  wide.cy = 88.0;
  return wide;
}

/// Calibrates what the rig's frames show, with its labels.
inline CalibrationResult CalibrateRig(const Rig& rig, const CalibrateOptions& options = {}) {
  StoredSegmenter segmenter = rig.PerfectSegmenter();
  return Calibrate(rig.frames, rig.structure, segmenter, options);
}

}  // namespace volalign::testing_infer

#pragma once

#include "infer/calib/calibrate.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::testing_infer {

/// Calibrates what the rig's frames show, with its labels.
inline CalibrationResult CalibrateRig(const Rig& rig, const CalibrateOptions& options = {}) {
  StoredSegmenter segmenter = rig.PerfectSegmenter();
  return Calibrate(rig.frames, rig.structure, segmenter, options);
}

}  // namespace volalign::testing_infer

#pragma once

#include <Eigen/Cholesky>
#include <vector>

#include "infer/calib/calibrate.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::testing_infer {

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

/// Of a pose, in standard deviations: chi-square with six degrees of freedom.
inline double SquaredError(const FrameResult& sensor, const SensorFrame& frame) {
  const Vector6d delta = LeftDifference(*sensor.structure_from_sensor, *frame.ground_truth);
  return delta.dot(sensor.covariance.ldlt().solve(delta));
}

}  // namespace volalign::testing_infer

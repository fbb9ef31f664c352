#pragma once

#include <Eigen/Cholesky>
#include <cstdint>
#include <string>
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

/// Of a pose, in standard deviations: chi-square with six degrees of freedom.
inline double SquaredError(const FrameResult& sensor, const SensorFrame& frame) {
  const Vector6d delta = LeftDifference(*sensor.structure_from_sensor, *frame.ground_truth);
  return delta.dot(sensor.covariance.ldlt().solve(delta));
}

/// Two sensors that look from both sides at six equal cartons in a row along x, alike from the
/// front and from behind, in a square room with a cupboard and a bench.
inline Rig RowFromBothSides(double azimuth) {
  std::vector<Box> row;
  for (int i = 0; i < 6; ++i)
    row.push_back(Box::FromMinMax("b" + std::to_string(i), {-0.9 + 0.3 * i, 0, -0.2},
                                  {-0.6 + 0.3 * i, 0.4, 0.2}));
  std::vector<Box> room = row;
  room.push_back(Box::FromMinMax("cupboard", {1.2, 0, -2.4}, {2.0, 1.8, -1.9}));
  room.push_back(Box::FromMinMax("bench", {-2.3, 0, 0.8}, {-1.5, 0.5, 1.8}));
  Rig rig{Structure::FromBoxes("room", room), {}, {}};
  for (int i = 0; i < 2; ++i) {
    rig.Add(RingPose(azimuth + 180 * i, 1.9, 0.9, 90, {0, 0.2, 0}), {true, 2.5});
    AddNoise(&rig.frames.back().depth, 0.004, static_cast<std::uint64_t>(i));
    rig.frames.back().quarter_turns = kAutoTurns;
  }
  rig.structure = Structure::FromBoxes("row", row);
  return rig;
}

}  // namespace volalign::testing_infer

#pragma once

// The expected accuracy of a rig, before anybody builds it.

// The frames of a planned rig's sensors, as far as they are known without a picture of the room:
// the stack and the floor.

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/image.h"
#include "core/base/progress_line.h"
#include "core/geometry/rig.h"
#include "core/geometry/structure.h"
#include "infer/calib/calibrate.h"
#include "infer/checks/outcome.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

struct PlannedFrame {
  SensorFrame frame;
  LabelImage labels;  ///< true labels
};

/// The stack as described, on its floor, seen with errors of the frame's kind (ErrorsOf). They are
/// drawn from `seed`: white, smooth, offset and gaps at depth edges. `frame` has name, kind,
/// intrinsics and pose (ground_truth).
PlannedFrame MeasurePlanned(SensorFrame frame, const Structure& structure, std::uint64_t seed,
                            std::uint64_t index);

struct PlannedSensor {
  std::string name, sensor;
  Intrinsics intrinsics;
  Pose structure_from_sensor = Pose::Identity();
  double distance_m = 0;  ///< to the structure's origin
  /// Names and pixels of the sides in view that have enough pixels, most first.
  std::vector<std::pair<std::string, int>> sides;
  bool sides_fix_pose = false;  ///< SidesFixPose of these
  /// Share of the surface that the sensor could see that is within its picture.
  double in_view = 0;
  int placed = 0;  ///< number of trials in which it is placed
  // Root mean squares of the position's distance from the true one and of the angle, by the
  // posterior covariance, over the trials in which it is placed.
  double expected_m = 0, expected_deg = 0;
  Matrix6d covariance = Matrix6d::Zero();  ///< mean over the trials
  /// Direction in which the position is least certain, unit vector, structure frame.
  Eigen::Vector3d weakest = Eigen::Vector3d::Zero();
  double weakest_m = 0;  ///< standard deviation along it
  /// By the worst trial.
  SensorStatus status = SensorStatus::kOk;
  Finding finding;
};

struct RigPlan {
  Structure structure;
  int trials = 0;
  std::vector<PlannedSensor> sensors;
  std::vector<PairResult> pairs;  ///< of the first trial
};

/// Calibrates the frames that the planned sensors would measure (MeasurePlanned), `trials` times
/// with other errors, with the true labels in place of a network's. Only the first of the rig's
/// placements counts, and nothing stands about the stack. `count` is called with the number of
/// trials done. No GL context. Throws ConfigError if the intrinsics pool lacks a sensor, and what
/// reading the rig's files throws.
RigPlan PlanRig(const Rig& rig, int trials, CalibrateOptions options = {},
                const CountDone& count = nullptr);

}  // namespace volalign

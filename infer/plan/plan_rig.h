#pragma once

// What a rig will be worth, before anybody builds it.

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/progress_line.h"
#include "core/geometry/rig.h"
#include "core/geometry/structure.h"
#include "infer/calib/calibrate.h"
#include "infer/checks/outcome.h"

namespace volalign {

struct PlannedSensor {
  std::string name, sensor;
  Intrinsics intrinsics;
  Pose structure_from_sensor = Pose::Identity();
  double distance_m = 0;  ///< to the structure's origin
  /// Sides in view, by how many pixels they have, those with enough of them to be used.
  std::vector<std::pair<std::string, int>> sides;
  bool sides_fix_pose = false;  ///< SidesFixPose of these
  /// Of the structure's surface that the sensor sees, the share within its picture.
  double in_view = 0;
  int placed = 0;  ///< in how many of the trials
  // Of the trials in which it is placed. Root of the mean square of the distance of the estimated
  // position from the true one, and of the angle, as the posterior covariance has them.
  double expected_m = 0, expected_deg = 0;
  Matrix6d covariance = Matrix6d::Zero();  ///< mean over the trials
  /// Direction in which the place is known least, unit vector, structure frame.
  Eigen::Vector3d weakest = Eigen::Vector3d::Zero();
  double weakest_m = 0;  ///< standard deviation along it
  /// Of the worst trial.
  SensorStatus status = SensorStatus::kOk;
  Finding finding;
};

struct RigPlan {
  Structure structure;
  int trials = 0;
  std::vector<PlannedSensor> sensors;
  std::vector<PairResult> pairs;  ///< of the first trial
};

/// Calibrates what the planned sensors would measure (MeasurePlanned), `trials` times with other
/// errors, with the true labels in place of a network's. Of the rig's placements only the first
/// counts, and nothing stands about the stack. `count` is told of trials. No GL context. Throws
/// ConfigError for what the intrinsics pool lacks, and what reading the rig's files throws.
RigPlan PlanRig(const Rig& rig, int trials, CalibrateOptions options = {},
                const CountDone& count = nullptr);

}  // namespace volalign

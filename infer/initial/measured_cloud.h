#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "core/geometry/kd_tree.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// What a sensor measured beside the structure, wherever that is of the poses that compete: points,
/// sensor frame, thinned out: few that are looked for, and many to find them among. A part of the
/// structure that a pose which is off by a box leaves over is no evidence of anything beside it.
class MeasuredCloud {
 public:
  /// `poses`: structure from sensor.
  MeasuredCloud(const SensorView& view, const Structure& structure, const std::vector<Pose>& poses);
  /// Share of another sensor's points that lie on this one's where the two have these poses; 0
  /// where it has none.
  double ShareOf(const MeasuredCloud& other, const Pose& pose, const Pose& pose_of_other) const;

 private:
  std::vector<Eigen::Vector3d> probes_;
  std::unique_ptr<KdTree> tree_;
};

}  // namespace volalign

#pragma once

#include <optional>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/pose_candidates.h"
#include "infer/initial/side_patch.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// For each patch, the centroid of the visible part of its side from the pose, structure frame, m.
/// Where that part is much smaller than the patch, the side's keypoint.
std::vector<Eigen::Vector3d> VisibleKeypoints(const SensorView& view,
                                              const std::vector<SidePatch>& patches,
                                              const Structure& structure,
                                              const Pose& structure_from_sensor);

/// Solves the pose again with VisibleKeypoints, because the centroid of a half-hidden side is not
/// that of the side. It uses the patches that agree with the pose within `max_distance_m`. Nothing
/// if these fix no pose.
std::optional<Pose> CorrectForVisibility(const SensorView& view,
                                         const std::vector<SidePatch>& patches,
                                         const Structure& structure, double max_distance_m,
                                         const Pose& structure_from_sensor);

}  // namespace volalign

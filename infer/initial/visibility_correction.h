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

/// One for each patch: the centroid, structure frame, of what the patch's side shows from the pose
/// and the view measured; the side's keypoint where that is much less than the patch.
std::vector<Eigen::Vector3d> VisibleKeypoints(const SensorView& view,
                                              const std::vector<SidePatch>& patches,
                                              const Structure& structure,
                                              const Pose& structure_from_sensor);

/// The centroid of a half-hidden side is not that of the side. Solves again with keypoints of what
/// the pose shows, over the patches that agree with the pose within `max_distance_m`. Nothing if
/// these fix no pose.
std::optional<Pose> CorrectForVisibility(const SensorView& view,
                                         const std::vector<SidePatch>& patches,
                                         const Structure& structure, double max_distance_m,
                                         const Pose& structure_from_sensor);

}  // namespace volalign

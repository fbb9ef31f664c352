#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <set>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/side_patch.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Indices of patches.
using PatchSet = std::set<std::size_t>;

/// m: largest distance between a side's keypoint and the measured one if they agree.
inline constexpr double kMostKeypointError = 0.2;

/// The keypoint of each patch's side, structure frame, m. The patch's centroid is compared with it.
std::vector<Eigen::Vector3d> SideKeypoints(const std::vector<SidePatch>& patches,
                                           const Structure& structure);

/// Weighted Procrustes over the members' keypoints and their fitted normals, because the centroids
/// of four parallel sides fix no rotation. Nothing if the members fix no pose.
std::optional<Pose> SolvePose(const std::vector<SidePatch>& patches, const PatchSet& members,
                              const std::vector<Eigen::Vector3d>& keypoints,
                              const Structure& structure);

/// The patches whose centroid lies within `max_distance_m` of its keypoint and whose normal agrees
/// with its side's. It agrees within 30 deg and two sigmas of its own uncertainty. If two patches
/// have one label, the nearer one counts.
PatchSet AgreeingPatches(const std::vector<SidePatch>& patches,
                         const std::vector<Eigen::Vector3d>& keypoints, const Structure& structure,
                         double max_distance_m, const Pose& structure_from_sensor);

/// Poses from all patches, and from every pair of the first ones. Each is solved again with the
/// patches that agree with it. The eight with the largest area of such patches are returned, the
/// largest first.
std::vector<Pose> FindCandidates(const std::vector<SidePatch>& patches, const Structure& structure);

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

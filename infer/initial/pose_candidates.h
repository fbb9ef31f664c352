#pragma once

#include <Eigen/Core>
#include <bitset>
#include <cstddef>
#include <optional>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/side_patch.h"

namespace volalign {

/// Most patches from which a pose is searched for.
inline constexpr std::size_t kMaxPatches = 64;

/// Indices of patches.
using PatchSet = std::bitset<kMaxPatches>;

/// At most kMaxPatches patches, the largest first.
std::vector<SidePatch> LargestPatches(std::vector<SidePatch> patches);

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

/// Poses from all patches, from all but one, and from every pair and triple of the largest ones.
/// Each is solved again with the patches that agree with it. The eight with the largest area of
/// such patches are returned, the largest first. With `near`, only poses that are about that one.
std::vector<Pose> FindCandidates(const std::vector<SidePatch>& patches, const Structure& structure,
                                 const Pose* near);

}  // namespace volalign

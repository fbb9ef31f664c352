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

/// Most patches among which a pose is looked for.
inline constexpr std::size_t kMaxPatches = 64;

/// Indices of patches.
using PatchSet = std::bitset<kMaxPatches>;

/// At most kMaxPatches patches, the largest first.
std::vector<SidePatch> LargestPatches(std::vector<SidePatch> patches);

/// m: distance between a side's keypoint and its measured one beyond which they contradict each
/// other.
inline constexpr double kMostKeypointError = 0.2;

/// One for each patch: its side's keypoint, with which the patch's centroid is compared, m.
std::vector<Eigen::Vector3d> SideKeypoints(const std::vector<SidePatch>& patches,
                                           const Structure& structure);

/// Weighted Procrustes over the members' keypoints and, as a second point of each side, its fitted
/// normal: the centroids of four parallel sides fix no rotation. Nothing if the members fix no
/// pose.
std::optional<Pose> SolvePose(const std::vector<SidePatch>& patches, const PatchSet& members,
                              const std::vector<Eigen::Vector3d>& keypoints,
                              const Structure& structure);

/// The patches whose centroid lies within `max_distance_m` of its keypoint, and whose normal is
/// within 30 deg and its own uncertainty of its side's; of two patches with
/// one label the nearer one.
PatchSet AgreeingPatches(const std::vector<SidePatch>& patches,
                         const std::vector<Eigen::Vector3d>& keypoints, const Structure& structure,
                         double max_distance_m, const Pose& structure_from_sensor);

/// Poses that follow from every pair and triple of the largest patches, from all patches and from
/// all but one, each solved again with the patches that agree with it: the eight with the largest
/// area of such patches, the largest first. With `near`, only those that are about that pose.
std::vector<Pose> FindCandidates(const std::vector<SidePatch>& patches, const Structure& structure,
                                 const Pose* near);

}  // namespace volalign

#pragma once

#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/aliases.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/pose_choice.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Does a calibration ask the network for poses, or geometry? `model`: there is a network.
bool AsksNetwork(PoseMethod method, bool model);
bool AsksGeometry(PoseMethod method);

/// The poses that compete for a view, and what speaks for each: those of the trials (PosesOfTrials)
/// and, where the method asks geometry, its own (FindPosesByGeometry),
/// but for those that turn the structure over where the orientation is known and has led to poses.
std::vector<PoseCandidate> FindCompetitors(const SensorView& view, const Structure& structure,
                                           const std::vector<StructureAlias>& aliases,
                                           const std::vector<PoseTrial>& trials, bool known_up,
                                           const InitialPoseOptions& initial);

/// The labels that a pose implies, and the initial pose that follows from them: what a network's
/// labels lead to, for a pose that geometry has found.
struct LabelledPose {
  SegmentationResult segmentation;
  InitialPose initial;
};
LabelledPose LabelByPose(const SensorView& view, const Structure& structure, const Pose& pose,
                         const InitialPoseOptions& options);

}  // namespace volalign

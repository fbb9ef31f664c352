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

/// Does a calibration take poses from the network, or from geometry? `model`: there is a network.
bool AsksNetwork(PoseMethod method, bool model);
bool AsksGeometry(PoseMethod method);

/// The poses that compete for a view, with their evidence: those of the trials (PosesOfTrials) and,
/// where the method uses geometry, those of FindPosesByGeometry. If `known_up` and the trials have
/// poses, geometry's poses that turn the structure over against all of them are left out.
std::vector<PoseCandidate> FindCompetitors(const SensorView& view, const Structure& structure,
                                           const std::vector<StructureAlias>& aliases,
                                           const std::vector<PoseTrial>& trials, bool known_up,
                                           const InitialPoseOptions& initial);

/// The labels that a pose found by geometry implies, and the initial pose that follows from them.
/// They take the place of a network's labels.
struct LabelledPose {
  SegmentationResult segmentation;
  InitialPose initial;
};
LabelledPose LabelByPose(const SensorView& view, const Structure& structure, const Pose& pose,
                         const InitialPoseOptions& options);

}  // namespace volalign

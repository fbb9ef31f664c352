#pragma once

#include <array>
#include <utility>
#include <vector>

#include "core/pose.h"
#include "core/structure.h"
#include "infer/pose/aliases.h"
#include "infer/pose/initial_pose.h"
#include "infer/pose/pose_choice.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Does a calibration ask the network for poses, or geometry? `model`: there is a network.
bool AsksNetwork(PoseMethod method, bool model);
bool AsksGeometry(PoseMethod method);

/// FindPosesByGeometry, with the floor as it speaks for each. What stands for the network's
/// opinion is how well the shape fits.
std::vector<PoseEvidence> ProposeByGeometry(const SensorView& view, const Structure& structure,
                                            const std::vector<StructureAlias>& aliases,
                                            const InitialPoseOptions& options);

/// The poses that compete when network and geometry have proposed theirs for a view: the network's
/// where geometry has none, or has the network's best one too; geometry's where the network's best
/// one does not have the structure's shape and its labels fit geometry's better; and else those of
/// both, judged alike. `trials`: those that the network's poses come from.
std::vector<PoseEvidence> CombineProposals(const SensorView& view, const Structure& structure,
                                           const std::vector<PoseTrial>& trials,
                                           std::vector<PoseEvidence> network,
                                           std::vector<PoseEvidence> geometry,
                                           const InitialPoseOptions& initial,
                                           const PoseChoiceOptions& options);

/// The labels that a pose implies, and the initial pose that follows from them: what a network's
/// labels lead to, for a pose that geometry has found.
struct LabelledPose {
  SegmentationResult segmentation;
  InitialPose initial;
};
LabelledPose LabelByPose(const SensorView& view, const Structure& structure, const Pose& pose,
                         const InitialPoseOptions& options);

}  // namespace volalign

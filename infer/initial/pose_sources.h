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

/// FindPosesByGeometry, with the floor as it speaks for each. What stands for the network's
/// opinion is how well the shape fits.
std::vector<PoseCandidate> ProposeByGeometry(const SensorView& view, const Structure& structure,
                                             const std::vector<StructureAlias>& aliases,
                                             const InitialPoseOptions& options);

/// The poses that compete when network and geometry have proposed theirs for a view: the network's
/// where geometry has none, or has the network's best one too; geometry's where the network's best
/// one does not have the structure's shape and its labels fit geometry's better; and else those of
/// both, judged alike. `trials`: those that the network's poses come from.
std::vector<PoseCandidate> CombineProposals(const SensorView& view, const Structure& structure,
                                            const std::vector<PoseTrial>& trials,
                                            std::vector<PoseCandidate> network,
                                            std::vector<PoseCandidate> geometry,
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

#pragma once

#include <vector>

#include "core/geometry/structure.h"
#include "infer/initial/pose_choice.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The poses among which a sensor's is chosen: those that compete (pose_sources.h), or the only
/// one. None: the sensor has no pose, and takes no part. The view must outlive the choice.
struct SensorCandidates {
  const SensorView* view = nullptr;
  std::vector<PoseCandidate> poses;
  /// Of each pose, the turns that bring the frame into the network's orientation; empty where they
  /// are given, or not known.
  std::vector<int> turns;
  /// What a person has chosen: 1, the pose that would be chosen; 2 and on, PoseAlternative::number;
  /// 0: nothing. The sensor is then beyond doubt, and the others are chosen to suit it. A number
  /// that it does not have, or whose pose the views refute by kDecisiveOdds, is ignored.
  int chosen = 0;
};

/// Chooses one pose for every sensor of a rig, all together, so that no sensor contradicts another:
/// those for which most speaks, in log odds, of
/// - each sensor's own depths, outline, floor and labels (PoseCandidate). Labels tell one step of a
///   spiral from the next, but not up from down: a network that is shown a part of the structure
///   upside down labels it about as well,
/// - what two sensors measured beside the structure, which does not lie where one of them sees
///   through it (infer/depth/measured_view.h),
/// - that the sensors of a rig are mounted alike: they have the same side of the picture up, or one
///   side where the picture stands upright and one where it lies on its side,
/// - and, where nothing else tells, that they are mounted as those that the network was trained on.
/// A sensor is ambiguous where another set of poses, in which it has another one, has odds of more
/// than 1 to kDecisiveOdds. Depths and outlines of a sensor count from odds of its square root on,
/// so that what says nothing in one view says nothing in many. Labels that prefer one of a pose and
/// its like upside down decide which is taken, but leave it ambiguous, and so does a single other
/// sensor that is mounted alike. Where nothing, not even the network's orientation, tells whether a
/// sensor is upside down as the others stand, its up is unknown: taken either way, it might
/// contradict them. Every set of poses that is the best in which some sensor has another pose than
/// the chosen one is listed with its odds (PoseAlternative).
std::vector<PoseChoice> ChooseTogether(const std::vector<SensorCandidates>& sensors,
                                       const Structure& structure);

}  // namespace volalign

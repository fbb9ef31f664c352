#pragma once

#include <vector>

#include "core/geometry/structure.h"
#include "infer/initial/pose_choice.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The poses among which a sensor's is chosen: those that compete (FindCompetitors), or the only
/// one. None: the sensor has no pose, and takes no part. The view must outlive the choice.
struct SensorCandidates {
  const SensorView* view = nullptr;
  std::vector<PoseCandidate> poses;
  /// Of each pose, the turns that bring the frame into the network's orientation; empty where they
  /// are given, or not known.
  std::vector<int> turns;
};

/// Chooses one pose for every sensor of a rig, all together, so that no sensor contradicts another:
/// those for which most speaks of
/// - each sensor's own floor and labels, as for one sensor alone (Decide),
/// - what two sensors measured beside the structure, which has to lie in the same places,
/// - that the sensors of a rig are mounted alike: they have the same side of the picture up, or one
///   side where the picture stands upright and one where it lies on its side,
/// - and, where nothing else tells, that they are mounted as those that the network was trained on.
/// A sensor is ambiguous where another set of poses, in which it has another one, has about as much
/// for it. Labels that prefer one of a pose and its like upside down decide which is taken, but
/// leave it ambiguous, and so does a single other sensor that is mounted alike. Where nothing, not
/// even the network's orientation, tells whether a sensor is upside down as the others stand, its
/// up is unknown: taken either way, it might contradict them.
std::vector<PoseChoice> ChooseTogether(const std::vector<SensorCandidates>& sensors,
                                       const Structure& structure,
                                       const PoseChoiceOptions& options);

}  // namespace volalign

#pragma once

#include <vector>

#include "core/geometry/structure.h"
#include "infer/initial/orientation.h"
#include "infer/initial/pose_hypotheses.h"
#include "infer/view/pose_prior.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The poses from which a sensor's is chosen. A sensor without poses takes no part. The view must
/// outlive the choice.
struct SensorHypotheses {
  const SensorView* view = nullptr;
  std::vector<Hypothesis> poses;
  /// A person's choice. 0 is none, 1 the pose that would be chosen, 2 and on
  /// PoseAlternative::number. The sensor is then beyond doubt, and the others are chosen to suit
  /// it. A number that it does not have, or whose pose the views refute by kDecisiveOdds, is
  /// ignored.
  int chosen = 0;
  const PosePrior* prior = nullptr;  ///< null: none
};

struct PoseChoice {
  bool found = false;
  Hypothesis best;     ///< about the chosen pose, a labelling's own if there is one
  bool given = false;  ///< a person has chosen the pose, see SensorHypotheses::chosen
  std::vector<PoseAlternative> alternatives;  ///< the most probable first

  /// Is another pose about as probable?
  bool ambiguous() const;
};

/// Chooses one pose for every sensor of a rig, all together, so that no sensor contradicts another.
/// It takes the set of poses with the largest sum of log odds. Five things count.
///
/// Each sensor's own depths, outline, floor and labels count (Hypothesis). Labels tell one step
/// of a spiral from the next, but not up from down: a network labels a part of the structure upside
/// down about as well. Two sensors' points beside the structure count where one sensor sees through
/// a surface that the other measured (infer/depth/measured_view.h). Sensors of a rig are usually
/// mounted alike: the same side of the picture is up, or one side for upright pictures and one for
/// those on their side. Where nothing else tells, they are assumed to be mounted as those that the
/// network was trained on. Priors of poses count in the world (FindWorlds) that suits the set best.
///
/// A sensor is ambiguous where another set of poses, in which it has another pose, has odds of more
/// than 1 to kDecisiveOdds. A sensor's depths and outline count from odds of its square root on, so
/// that small differences in many views do not add up. Labels that prefer a pose to the same one
/// upside down decide which is taken, but leave the sensor ambiguous. So does a single other sensor
/// that is mounted alike. PoseAlternative lists every
/// set of poses that is the best in which some sensor has another pose than the chosen one.
std::vector<PoseChoice> ChooseTogether(const std::vector<SensorHypotheses>& sensors,
                                       const Structure& structure);

}  // namespace volalign

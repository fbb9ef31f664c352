#pragma once

#include <vector>

#include "core/geometry/pose.h"
#include "infer/view/pose_prior.h"

namespace volalign {

/// Where the world of pose priors lies in the structure frame, as a similarity.
struct WorldPlacement {
  Pose structure_from_world = Pose::Identity();
  double scale = 1;  ///< m of the structure per unit of the world

  /// The pose structure_from_sensor that a prior has.
  Pose Place(const Pose& world_from_sensor) const;
};

/// The natural logarithm of the likelihood of a sensor's pose under its prior, up to a constant.
/// One prior in a thousand is taken to be wrong: it then says that the sensor is anywhere in a
/// room.
double PriorLogLikelihood(const PosePrior& prior, const Pose& expected, const Pose& pose);

/// Where the world may lie, the likeliest place first. `priors`: of each sensor, or null; all have
/// one PosePrior::world. `poses`: the poses that each sensor may have. A world that is the
/// structure's frame lies there. Else it is empty if no sensor has both, or, for a world of unknown
/// scale, if fewer than three have.
std::vector<WorldPlacement> FindWorlds(const std::vector<const PosePrior*>& priors,
                                       const std::vector<std::vector<Pose>>& poses);

}  // namespace volalign

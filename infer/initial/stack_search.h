#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "core/geometry/pose.h"
#include "infer/initial/oriented_points.h"
#include "infer/initial/stack_outline.h"

namespace volalign {

/// Which way is up, and what else is known about how the structure stands. Sensor frame.
struct StandingGuess {
  Eigen::Vector3d up = Eigen::Vector3d::UnitY();  ///< unit
  std::vector<double> feet;  ///< up . p of planes that the structure may stand on, m
  /// Turns about `up`, rad, from the room frame of RoomFromSensor; empty: every one.
  std::vector<double> yaws;
};

/// The turn from a sensor into a frame whose y is `up`.
Eigen::Matrix3d RoomFromSensor(const Eigen::Vector3d& up);

struct StackCandidate {
  Pose structure_from_sensor = Pose::Identity();
  double votes = 0;  ///< cells of the outline that were measured, less those inside
};

/// Where the structure may stand, for each guess: for every turn about the vertical, the measured
/// surfaces above the foot, in cells of horizontal slabs, are correlated with the structure's
/// outline. A measured cell counts 1 on a side that faces the same way, and -1.5 inside the
/// structure. At most `most` candidates of each guess, those with the most votes first. All guesses
/// have the same `yaws`.
std::vector<std::vector<StackCandidate>> SearchStack(const std::vector<OrientedPoint>& points,
                                                     const StackOutline& outline,
                                                     const std::vector<StandingGuess>& guesses,
                                                     std::size_t most);

}  // namespace volalign

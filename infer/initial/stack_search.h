#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "core/geometry/pose.h"
#include "infer/initial/oriented_points.h"
#include "infer/initial/stack_outline.h"

namespace volalign {

/// The vertical, and what else is known about how the structure stands. Sensor frame.
struct StandingGuess {
  Eigen::Vector3d up = Eigen::Vector3d::UnitY();  ///< unit
  std::vector<double> feet;  ///< up . p of planes that may carry the structure, m
  /// Turns about `up`, rad, from the frame of RoomFromSensor; empty: every one.
  std::vector<double> yaws;
};

/// The turn from a sensor into a frame whose y is `up`.
Eigen::Matrix3d RoomFromSensor(const Eigen::Vector3d& up);

struct StackCandidate {
  Pose structure_from_sensor = Pose::Identity();
  double votes = 0;  ///< measured cells of the outline, less those inside
};

/// Finds where the structure may stand, for each guess. For every turn about the vertical, the
/// measured surfaces above the foot are correlated with the structure's outline, in cells of
/// horizontal slabs. A measured cell counts up to 1 on a side that faces the same way, and down to
/// kInsideVote inside the structure. There are at most `most` candidates per guess, those with the
/// most votes first. All guesses must have the same `yaws`.
std::vector<std::vector<StackCandidate>> SearchStack(const std::vector<OrientedPoint>& points,
                                                     const StackOutline& outline,
                                                     const std::vector<StandingGuess>& guesses,
                                                     std::size_t most);

}  // namespace volalign

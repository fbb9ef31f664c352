#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "core/pose.h"
#include "core/structure.h"
#include "infer/pose/oriented_points.h"

namespace volalign {

/// A piece of a structure's surface, or of its inside, about the structure's middle, m.
struct StackPiece {
  enum Kind { kSide, kTop, kInside };
  double x = 0, z = 0;
  int slab = 0;
  double heading = 0;  ///< of a side's normal, rad
  Kind kind = kSide;
  double weight = 0;  ///< of what a cell counts in which it lies
};

/// A structure in horizontal slabs, and how finely it is searched for, as its own boxes have it.
struct StackOutline {
  double cell = 0;                   ///< m, horizontally
  double slab = 0;                   ///< m, vertically
  int slabs = 0;                     ///< from the structure's foot up
  double yaw_step = 0;               ///< rad
  double radius = 0;                 ///< m, of the structure about its middle
  Eigen::Vector3d foot = {0, 0, 0};  ///< the structure's middle, at its lowest y
  std::vector<StackPiece> pieces;
};
/// `cells`: along the smallest edge of any box, where that gives no extreme size.
StackOutline MakeStackOutline(const Structure& structure, double cells = 8);

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

/// Where the structure may stand: for every turn about the vertical, the measured surfaces above
/// the foot, in cells of horizontal slabs, are correlated with the structure's outline. A measured
/// cell counts 1 on a side that faces the same way, and -1.5 inside the structure. At most `most`
/// candidates, those with the most votes first.
std::vector<StackCandidate> SearchStack(const std::vector<OrientedPoint>& points,
                                        const StackOutline& outline, const StandingGuess& guess,
                                        std::size_t most);

}  // namespace volalign

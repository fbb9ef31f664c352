#pragma once

// How the structure was really built, as parameters. Not for callers of Refine.

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"

namespace volalign::refine_internal {

/// Parameters of the structure's real build, two Ceres blocks: size scale - 1; and of each box its
/// x, z (m) and yaw (rad, about the vertical through its centre). Box b of the scaled stack stands
/// on the same floor: its centre rises by (size scale - 1) * (its height above the floor).
struct BuildParameters {
  const double* size;
  const double* boxes;
};
class BuildModel {
 public:
  explicit BuildModel(const Structure& structure)
      : structure_(&structure), floor_(structure.FloorHeight()) {}
  const Structure& structure() const { return *structure_; }
  double floor() const { return floor_; }
  /// How many parameters the boxes have. X, Z and Yaw are indices of one box's.
  int box_parameters() const { return 3 * static_cast<int>(structure_->boxes().size()); }
  static int X(int box) { return 3 * box; }
  static int Z(int box) { return 3 * box + 1; }
  static int Yaw(int box) { return 3 * box + 2; }
  /// Where the box went: structure_from_box' = Offset * structure_from_box (before scaling).
  Pose Offset(const BuildParameters& build, int box) const;
  /// structure() as built.
  Structure Built(const BuildParameters& build) const;

 private:
  const Structure* structure_;
  double floor_;
};

}  // namespace volalign::refine_internal

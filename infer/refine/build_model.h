#pragma once

// How the structure was really built, as parameters. Not for callers of Refine.

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"

namespace volalign::refine_internal {

/// Parameters of the structure as built, three Ceres blocks. `size`: size scale - 1. `boxes`: x, z
/// (m) and yaw (rad, about the vertical through its centre) of each box. `bulges`: how far the
/// middle of each labelled side bulges, m (Side::BulgeAt). The scaled stack stands on the same
/// floor: the centre of a box rises by (size scale - 1) * (its height above the floor).
struct BuildParameters {
  const double* size;
  const double* boxes;
  const double* bulges = nullptr;
};
/// How many boxes and labelled sides a structure has.
struct BuildSize {
  int boxes = 0, sides = 0;
  /// The number of their parameters. Those of boxes come first.
  int parameters() const { return 3 * boxes + sides; }
};
class BuildModel {
 public:
  explicit BuildModel(const Structure& structure)
      : structure_(&structure), floor_(structure.FloorHeight()) {}
  const Structure& structure() const { return *structure_; }
  double floor() const { return floor_; }
  BuildSize size() const {
    return {static_cast<int>(structure_->boxes().size()), structure_->num_classes() - 1};
  }
  /// Indices of one box's parameters, and of a side's bulge among those of all sides.
  static int X(int box) { return 3 * box; }
  static int Z(int box) { return 3 * box + 1; }
  static int Yaw(int box) { return 3 * box + 2; }
  static int Bulge(int label) { return label - 1; }
  /// The movement of a box: structure_from_box' = Offset * structure_from_box (before scaling).
  Pose Offset(const BuildParameters& build, int box) const;
  /// structure() as built.
  Structure Built(const BuildParameters& build) const;

 private:
  const Structure* structure_;
  double floor_;
};

}  // namespace volalign::refine_internal

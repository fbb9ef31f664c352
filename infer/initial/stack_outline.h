#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/view/alike.h"

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

  /// The slab at a height above the foot; the structure's are 0 to slabs - 1.
  int SlabAt(double height) const { return static_cast<int>(std::floor(height / slab)); }
  bool Has(int slab_index) const { return slab_index >= 0 && slab_index < slabs; }
};
/// Cells along the smallest horizontal edge of any box, if that makes them small enough.
inline constexpr double kCellsAlongEdge = 8;
StackOutline MakeStackOutline(const Structure& structure, double cells = kCellsAlongEdge);

/// Upward part of a unit normal from which on a surface counts as a top, and up to which as a side;
/// in between and below it counts as neither.
inline constexpr double kFacesUp = kFacesAlike, kFacesAside = 0.5;

/// What a measured cell counts that lies inside the structure.
inline constexpr double kInsideVote = -1;

/// Direction of a normal in the horizontal plane, rad.
inline double Heading(const Eigen::Vector3d& normal) { return std::atan2(normal.z(), normal.x()); }

}  // namespace volalign

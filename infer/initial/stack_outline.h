#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/view/alike.h"

namespace volalign {

/// A piece of a structure's surface or inside. x and z are relative to the structure's middle, m.
struct StackPiece {
  enum Kind { kSide, kTop, kInside };
  double x = 0, z = 0;
  int slab = 0;
  double heading = 0;  ///< rad, of a side's normal
  Kind kind = kSide;
  double weight = 0;  ///< vote of a measured cell there
};

/// A structure in horizontal slabs, and the steps of the search for it, which follow from its
/// boxes.
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
Eigen::AlignedBox3d BoundsOf(const Structure& structure);

/// Cells along the smallest horizontal edge of any box. MakeStackOutline limits their size.
inline constexpr double kCellsAlongEdge = 8;
StackOutline MakeStackOutline(const Structure& structure, double cells = kCellsAlongEdge);

/// Upward part of a unit normal from which on a surface is a top, and up to which it is a side.
/// Other surfaces are neither.
inline constexpr double kFacesUp = kFacesAlike, kFacesAside = 0.5;

/// Vote of a measured cell inside the structure.
inline constexpr double kInsideVote = -1;

/// Direction of a normal in the horizontal plane, rad.
inline double Heading(const Eigen::Vector3d& normal) { return std::atan2(normal.z(), normal.x()); }

}  // namespace volalign

#include "infer/initial/stack_outline.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

#include "core/geometry/visibility.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Slabs of the lowest box.
constexpr double kSlabsPerBox = 3;
constexpr double kMostCell = 2 * kRoughPose, kMostSlab = 0.2;  // m
/// Most cells along the structure's radius, and slabs along its height. Details that are small
/// beside the whole need not be seen to find it.
constexpr double kMostCells = 16;
/// Inside begins so many cells behind the surface: a diagonal.
constexpr double kInsideDepth = M_SQRT2;

std::vector<StackPiece> Pieces(const Structure& structure, const StackOutline& outline) {
  std::vector<StackPiece> pieces;
  const double area = outline.cell * outline.cell;
  for (const Eigen::Vector3d& p : SampleExposedSurface(structure, outline.cell)) {
    const int side = DistanceToSurface(structure, p).side;
    const Eigen::Vector3d& normal = structure.sides()[static_cast<std::size_t>(side)].normal;
    const Eigen::Vector3d local = p - outline.foot;
    const bool top = normal.y() > kFacesUp;
    if (!top && std::abs(normal.y()) > kFacesAside) continue;
    // A top counts for the slab in which it is measured, a little below or above it.
    const int slab = outline.SlabAt(local.y() - (top ? outline.slab / 8 : 0));
    if (!outline.Has(slab)) continue;
    pieces.push_back({local.x(), local.z(), slab, Heading(normal),
                      top ? StackPiece::kTop : StackPiece::kSide,
                      top ? 1.0 : area / (outline.cell * outline.slab)});
  }
  for (int slab = 0; slab < outline.slabs; ++slab) {
    for (double x = -outline.radius; x < outline.radius; x += outline.cell) {
      for (double z = -outline.radius; z < outline.radius; z += outline.cell) {
        const Eigen::Vector3d local(x, (slab + 0.5) * outline.slab, z);
        const Eigen::Vector3d p = outline.foot + local;
        if (!structure.Contains(p)) continue;
        if (DistanceToSurface(structure, p).distance < kInsideDepth * outline.cell) continue;
        pieces.push_back({x, z, slab, 0, StackPiece::kInside, kInsideVote});
      }
    }
  }
  return pieces;
}

}  // namespace

Eigen::AlignedBox3d BoundsOf(const Structure& structure) {
  Eigen::AlignedBox3d bounds;
  for (const Box& box : structure.boxes()) {
    for (const Eigen::Vector3d& corner : box.Corners()) bounds.extend(corner);
  }
  return bounds;
}

StackOutline MakeStackOutline(const Structure& structure, double cells) {
  double smallest = std::numeric_limits<double>::infinity(), lowest = smallest;
  for (const Box& box : structure.boxes()) {
    smallest = std::min({smallest, box.size.x(), box.size.z()});
    lowest = std::min(lowest, box.size.y());
  }
  const Eigen::AlignedBox3d bounds = BoundsOf(structure);
  StackOutline outline;
  outline.foot = bounds.center();
  outline.foot.y() = structure.FloorHeight();
  outline.radius = std::hypot(bounds.sizes().x(), bounds.sizes().z()) / 2;
  outline.cell = std::max(std::min(smallest / cells, kMostCell), outline.radius / kMostCells);
  outline.slab = std::min(lowest / kSlabsPerBox, kMostSlab);
  outline.slab = std::max(outline.slab, structure.Height() / kMostCells);
  outline.slabs = static_cast<int>(std::lround(structure.Height() / outline.slab)) + 1;
  outline.yaw_step = outline.cell / outline.radius;
  outline.pieces = Pieces(structure, outline);
  return outline;
}

}  // namespace volalign

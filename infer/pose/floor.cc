#include "infer/pose/floor.h"

#include <algorithm>
#include <cmath>

#include "core/visibility.h"

namespace volalign {

namespace {

/// Distance within which a point lies on the floor: depth errors grow with distance, and a pose
/// that is off by a degree tilts a far floor. In m, and per metre of depth.
constexpr double kTolerance = 0.03, kRelativeTolerance = 0.02;
/// Of these tolerances, from which on a point is clearly under the floor.
constexpr double kClearlyBelow = 3;
/// Every second pixel of every second row is looked at.
constexpr int kStride = 2;

}  // namespace

FloorEvidence FindFloor(const SensorView& view, const Structure& structure,
                        const Pose& structure_from_sensor, double table_height_m) {
  const double floor = structure.FloorHeight() - table_height_m;
  FloorEvidence evidence;
  for (int v = kStride / 2; v < view.height(); v += kStride) {
    for (int u = kStride / 2; u < view.width(); u += kStride) {
      if (!(view.depth(u, v) > 0)) continue;
      ++evidence.pixels;
      if (table_height_m < 0) continue;
      const Eigen::Vector3d p = structure_from_sensor * view.Point(u, v);
      const double tolerance = kTolerance + kRelativeTolerance * view.depth(u, v);
      const double height = p.y() - floor;
      if (height < -kClearlyBelow * tolerance) {
        ++evidence.below;
      } else if (std::abs(height) < tolerance &&
                 DistanceToSurface(structure, p).distance > kTolerance) {
        ++evidence.on_floor;
      }
    }
  }
  return evidence;
}

double FloorMargin(const SensorView& view, const Structure& structure,
                   const std::vector<StructureAlias>& aliases, const Pose& structure_from_sensor,
                   double table_height_m) {
  const double own = FindFloor(view, structure, structure_from_sensor, table_height_m).share();
  double margin = 1;
  for (const StructureAlias& alias : aliases) {
    const Pose moved = alias.motion * structure_from_sensor;
    margin = std::min(margin, own - FindFloor(view, structure, moved, table_height_m).share());
  }
  return margin;
}

}  // namespace volalign

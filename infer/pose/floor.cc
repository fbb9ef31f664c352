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
/// px to each side of a point over which its surface's normal is taken, and the least cosine (of 45
/// deg) of the angle between that of a floor and the vertical: depths are noisy.
constexpr int kReach = 3;
constexpr double kLevel = 0.7;

/// Is the surface at this pixel level, at this pose? What has no depth beside it is not.
bool IsLevel(const SensorView& view, int u, int v, const Pose& structure_from_sensor) {
  const auto point = [&](int x, int y) {
    const bool measured =
        x >= 0 && x < view.width() && y >= 0 && y < view.height() && view.depth(x, y) > 0;
    return measured ? view.Point(x, y) : view.Point(u, v);
  };
  const Eigen::Vector3d along_u = point(u + kReach, v) - point(u - kReach, v);
  const Eigen::Vector3d along_v = point(u, v + kReach) - point(u, v - kReach);
  const Eigen::Vector3d normal = structure_from_sensor.linear() * along_u.cross(along_v);
  return normal.norm() > 0 && std::abs(normal.y()) >= kLevel * normal.norm();
}

}  // namespace

FloorEvidence FindFloor(const SensorView& view, const Structure& structure,
                        const Pose& structure_from_sensor, const std::vector<Pose>& rivals) {
  const auto is_off = [&](const Eigen::Vector3d& measured, const Pose& pose) {
    return DistanceToSurface(structure, pose * measured).distance > kTolerance;
  };
  const double floor = structure.FloorHeight();
  FloorEvidence evidence;
  for (int v = kStride / 2; v < view.height(); v += kStride) {
    for (int u = kStride / 2; u < view.width(); u += kStride) {
      if (!(view.depth(u, v) > 0)) continue;
      ++evidence.pixels;
      const Eigen::Vector3d measured = view.Point(u, v);
      const double tolerance = kTolerance + kRelativeTolerance * view.depth(u, v);
      const double height = (structure_from_sensor * measured).y() - floor;
      if (height < -kClearlyBelow * tolerance) {
        ++evidence.below;
      } else if (std::abs(height) < tolerance && is_off(measured, structure_from_sensor) &&
                 IsLevel(view, u, v, structure_from_sensor) &&
                 std::all_of(rivals.begin(), rivals.end(),
                             [&](const Pose& rival) { return is_off(measured, rival); })) {
        ++evidence.on_floor;
      }
    }
  }
  return evidence;
}

double FloorMargin(const SensorView& view, const Structure& structure,
                   const std::vector<StructureAlias>& aliases, const Pose& structure_from_sensor) {
  std::vector<Pose> poses = {structure_from_sensor};
  for (const StructureAlias& alias : aliases) poses.push_back(alias.motion * structure_from_sensor);
  const double own = FindFloor(view, structure, structure_from_sensor, poses).share();
  double margin = 1;
  for (std::size_t a = 1; a < poses.size(); ++a)
    margin = std::min(margin, own - FindFloor(view, structure, poses[a], poses).share());
  return margin;
}

}  // namespace volalign

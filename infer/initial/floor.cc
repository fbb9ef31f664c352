#include "infer/initial/floor.h"

#include <cmath>
#include <map>

#include "core/geometry/visibility.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Distance within which a point lies on the floor: depth errors grow with distance, and a pose
/// that is off by a degree tilts a far floor. In m, and per metre of depth.
constexpr double kTolerance = kRoughPose, kRelativeTolerance = 0.02;
/// Every second pixel of every second row is looked at.
constexpr int kStride = 2;
/// m: a floor that is less far under the structure is no floor that a table stands on.
constexpr double kLeastTable = 0.3;
/// Share of the pixels that such a floor needs, and the cells of height in which it is looked for,
/// m.
constexpr double kLeastLowerFloor = 0.05, kLevelCell = 0.05;

/// Upward part of the normal, towards the sensor, of the surface at this pixel, at this pose; 0 of
/// what has no depth beside it.
double FacesUp(const SensorView& view, int u, int v, const Pose& structure_from_sensor) {
  const auto point = [&](int x, int y) {
    const bool measured =
        x >= 0 && x < view.width() && y >= 0 && y < view.height() && view.depth(x, y) > 0;
    return measured ? view.Point(x, y) : view.Point(u, v);
  };
  const Eigen::Vector3d along_u = point(u + kNormalRadius, v) - point(u - kNormalRadius, v);
  const Eigen::Vector3d along_v = point(u, v + kNormalRadius) - point(u, v - kNormalRadius);
  Eigen::Vector3d normal = along_u.cross(along_v);
  if (!(normal.norm() > 0)) return 0;
  if (normal.dot(view.Point(u, v)) > 0) normal = -normal;
  return structure_from_sensor.linear().row(1).dot(normal) / normal.norm();
}

/// A point clearly under the structure's foot.
struct LowPoint {
  double depth = 0;    // m, under the foot
  double clearly = 0;  // m, by which a point has to be lower than another to be clearly under it
  bool faces_up = false;
};

/// How far under the foot most of the surface is that faces up, m: the floor that a table may stand
/// on. 0 where there is too little.
double LowerFloor(const std::vector<LowPoint>& points, int pixels) {
  std::map<int, int> cells;
  for (const LowPoint& point : points) {
    if (point.faces_up && point.depth >= kLeastTable)
      ++cells[static_cast<int>(std::lround(point.depth / kLevelCell))];
  }
  int most = 0;
  double depth = 0;
  for (const auto& [cell, count] : cells) {
    const auto next = cells.find(cell + 1);
    const int both = count + (next != cells.end() ? next->second : 0);
    if (both <= most) continue;
    most = both;
    depth = (cell + 0.5) * kLevelCell;
  }
  return most >= kLeastLowerFloor * pixels ? depth : 0;
}

}  // namespace

FloorFit FindFloor(const SensorView& view, const Structure& structure,
                   const Pose& structure_from_sensor, double table_height_m,
                   const std::vector<Pose>& rivals) {
  const auto is_off = [&](const Eigen::Vector3d& measured, const Pose& pose) {
    return DistanceToSurface(structure, pose * measured).distance > kTolerance;
  };
  const double floor = structure.FloorHeight() - table_height_m;
  FloorFit fit;
  std::vector<LowPoint> low;
  view.VisitMeasured(kStride, [&](int u, int v) {
    ++fit.pixels;
    if (table_height_m < 0) return;
    const Eigen::Vector3d measured = view.Point(u, v);
    const double tolerance = kTolerance + kRelativeTolerance * view.depth(u, v);
    const double height = (structure_from_sensor * measured).y() - floor;
    const auto faces_up = [&] { return FacesUp(view, u, v, structure_from_sensor); };
    if (height < -kClearly * tolerance) {
      low.push_back({-height, kClearly * tolerance, faces_up() >= kFacesAlike});
    } else if (std::abs(height) < tolerance && is_off(measured, structure_from_sensor) &&
               std::abs(faces_up()) >= kFacesAlike &&
               std::all_of(rivals.begin(), rivals.end(),
                           [&](const Pose& rival) { return is_off(measured, rival); })) {
      ++fit.on_floor;
    }
  });
  const double lower = table_height_m == 0 ? LowerFloor(low, fit.pixels) : 0;
  for (const LowPoint& point : low) fit.below += point.depth > lower + point.clearly;
  return fit;
}

double FloorMargin(const SensorView& view, const Structure& structure,
                   const std::vector<StructureAlias>& aliases, const Pose& structure_from_sensor,
                   double table_height_m) {
  std::vector<Pose> poses = {structure_from_sensor};
  for (const StructureAlias& alias : aliases) poses.push_back(alias.motion * structure_from_sensor);
  const auto share = [&](const Pose& pose) {
    return FindFloor(view, structure, pose, table_height_m, poses).share();
  };
  const double own = share(structure_from_sensor);
  double margin = 1;
  for (std::size_t a = 1; a < poses.size(); ++a) margin = std::min(margin, own - share(poses[a]));
  return margin;
}

}  // namespace volalign

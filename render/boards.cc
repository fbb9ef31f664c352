#include "render/boards.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "core/base/statistics.h"
#include "core/geometry/visibility.h"

namespace volalign {

namespace {

constexpr double kDistance = 0.7;    // m, horizontally from the sensor
constexpr double kThickness = 0.02;  // m
constexpr double kMargin = 0.3;      // m, by which a board is larger than the hidden part

/// The places where a sensor's rays to the structure pass through the board's upright plane.
struct Window {
  Eigen::Vector3d foot;  // below the sensor, on the floor
  Eigen::Vector3d forward, right;
  std::vector<double> sides, heights;  // along `right`, and above the floor, m
};

Window FindWindow(const Structure& structure, const RayTable& rays,
                  const Pose& structure_from_sensor) {
  const ExpectedView seen = CastView(structure, rays, structure_from_sensor);
  const Eigen::Vector3d& origin = structure_from_sensor.translation();
  Window window;
  window.foot = {origin.x(), structure.FloorHeight(), origin.z()};
  std::vector<Eigen::Vector3d> directions;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (int v = 0; v < rays.height; ++v) {
    for (int u = 0; u < rays.width; ++u) {
      if (seen.labels(u, v) == 0) continue;
      const Eigen::Vector2f& ray = rays.at(u, v);
      directions.push_back(structure_from_sensor.linear() *
                           Eigen::Vector3d(ray.x(), ray.y(), 1).normalized());
      mean += directions.back();
    }
  }
  if (directions.empty()) return window;
  window.forward = Eigen::Vector3d(mean.x(), 0, mean.z()).normalized();
  window.right = window.forward.cross(Eigen::Vector3d::UnitY());
  for (const Eigen::Vector3d& direction : directions) {
    const double t = kDistance / window.forward.dot(direction);
    if (!(t > 0)) continue;
    window.sides.push_back(t * window.right.dot(direction));
    window.heights.push_back(origin.y() + t * direction.y() - window.foot.y());
  }
  std::sort(window.sides.begin(), window.sides.end());
  std::sort(window.heights.begin(), window.heights.end());
  return window;
}

}  // namespace

void AppendBoard(const Structure& structure, const RayTable& rays,
                 const Pose& structure_from_sensor, double share, BoardEdge edge, SceneMesh* mesh) {
  const Window window = FindWindow(structure, rays, structure_from_sensor);
  if (window.sides.empty()) return;
  double left = window.sides.front() - kMargin, right = window.sides.back() + kMargin;
  double top = window.heights.back() + kMargin;
  if (edge == BoardEdge::kLeft) right = Quantile(window.sides, share);
  if (edge == BoardEdge::kRight) left = Quantile(window.sides, 1 - share);
  if (edge == BoardEdge::kBelow) top = Quantile(window.heights, share);
  if (!(top > 0)) return;
  Pose pose = Pose::Identity();
  pose.linear().col(0) = window.right;
  pose.linear().col(1) = Eigen::Vector3d::UnitY();
  pose.linear().col(2) = window.right.cross(Eigen::Vector3d::UnitY());
  // The face towards the sensor is in the plane of the rays' places.
  pose.translation() = window.foot + (kDistance + kThickness / 2) * window.forward +
                       (left + right) / 2 * window.right + Eigen::Vector3d(0, top / 2, 0);
  mesh->BeginObject(SceneObject());
  mesh->AppendBox(pose, {right - left, top, kThickness});
}

}  // namespace volalign

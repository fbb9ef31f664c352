#include "infer/plan/planned_frame.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/noise_fields.h"
#include "core/base/random.h"
#include "core/geometry/lens.h"
#include "core/geometry/sensor_kind.h"
#include "core/geometry/visibility.h"

namespace volalign {

namespace {

constexpr float kEdgeStep = 0.08F;  // m, least step between neighbours that is a depth edge
constexpr double kFarthest = 12;    // m, of the floor

/// Adds the floor where nothing stands before it.
void AddFloor(const RayTable& rays, const Pose& structure_from_sensor, double height,
              DepthImage* depth) {
  for (int v = 0; v < depth->height(); ++v) {
    for (int u = 0; u < depth->width(); ++u) {
      const Eigen::Vector2f& ray = rays.at(u, v);
      if ((*depth)(u, v) > 0 || !ray.allFinite()) continue;
      const double falls =
          (structure_from_sensor.linear() * Eigen::Vector3d(ray.x(), ray.y(), 1)).y();
      const double z = (height - structure_from_sensor.translation().y()) / falls;
      if (falls < 0 && z < kFarthest) (*depth)(u, v) = static_cast<float>(z);
    }
  }
}

/// Removes `count` pixels on the far side of every depth edge, along rows and columns.
void LeaveGaps(int count, PlannedFrame* planned) {
  DepthImage& depth = planned->frame.depth;
  const DepthImage before = depth;
  const auto clear = [&](int u, int v, int du, int dv) {
    for (int k = 0; k < count && depth.Contains(u, v); ++k, u += du, v += dv) {
      depth(u, v) = 0;
      planned->labels(u, v) = 0;
    }
  };
  ForEachNeighbourPair(before.width(), before.height(),
                       [&](int u, int v, int p, int q, std::uint64_t /*pair*/) {
                         const float a = before(u, v), b = before(p, q);
                         if (a == 0 || b == 0 || std::abs(a - b) < kEdgeStep) return;
                         if (a < b) {
                           clear(p, q, p - u, q - v);
                         } else {
                           clear(u, v, u - p, v - q);
                         }
                       });
}

}  // namespace

PlannedFrame MeasurePlanned(SensorFrame frame, const Structure& structure, std::uint64_t seed,
                            std::uint64_t index) {
  const Pose& pose = *frame.ground_truth;
  const RayTable rays = ComputeRays(frame.intrinsics);
  ExpectedView view = CastView(structure, rays, pose);
  AddFloor(rays, pose, structure.FloorHeight(), &view.depth);
  PlannedFrame planned{std::move(frame), std::move(view.labels)};
  planned.frame.depth = std::move(view.depth);
  DepthImage& depth = planned.frame.depth;
  const DepthErrorModel& errors = ErrorsOf(planned.frame.sensor);
  const double focal = planned.frame.intrinsics.fx;
  LeaveGaps(static_cast<int>(std::lround(errors.edge_gap_rad * focal)), &planned);
  RandomStream random(seed, index, "planned");
  const Image<float> smooth =
      SmoothField(depth.width(), depth.height(), errors.smooth_rad * focal, random);
  const double offset = errors.offset_m * random.Normal();
  const PixelRandom pixel(random);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    const double z = depth[i];
    if (z == 0) continue;
    const double error = offset + errors.White(z) * pixel.Normal(i) + errors.Smooth(z) * smooth[i];
    depth[i] = static_cast<float>(std::max(0.001, z + error));
  }
  return planned;
}

}  // namespace volalign

#include "infer/report/ply.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <string>

#include "core/base/file_util.h"
#include "core/geometry/visibility.h"
#include "core/plot/picture.h"
#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

/// Appends a value's bytes, little-endian first.
template <class T>
void Append(std::string* bytes, T value) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, sizeof(T));
#if __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
  std::reverse(raw.begin(), raw.end());
#endif
  bytes->append(raw.data(), raw.size());
}

}  // namespace

std::vector<AlignedPoint> AlignedPoints(const FrameResult& sensor, const Structure& structure,
                                        double max_radius) {
  std::vector<AlignedPoint> points;
  if (!sensor.structure_from_sensor) return points;
  const SensorView view = Corrected(sensor.view, sensor.depth_gain, sensor.depth_offset_m);
  constexpr Rgb kBackground{150, 150, 150};
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      if (!(view.depth(u, v) > 0)) continue;
      const Eigen::Vector3d p = *sensor.structure_from_sensor * view.Point(u, v);
      if (std::hypot(p.x(), p.z()) > max_radius) continue;
      AlignedPoint point;
      point.p = p.cast<float>();
      point.label = sensor.segmentation.labels(u, v);
      point.confidence = sensor.segmentation.confidence(u, v);
      const bool side = point.label > 0 && point.label < structure.num_classes();
      point.colour = side ? LabelColour(point.label) : kBackground;
      point.residual =
          static_cast<float>(side ? (structure.SideOfLabel(point.label).ClosestPoint(p) - p).norm()
                                  : DistanceToSurface(structure, p).distance);
      if (side) {
        const Side& named = structure.SideOfLabel(point.label);
        point.side_residual = static_cast<float>(named.normal.dot(p - named.centre));
      }
      points.push_back(point);
    }
  }
  return points;
}

void WritePly(const std::filesystem::path& path, const std::vector<AlignedPoint>& points,
              const std::optional<WorldFrame>& world) {
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\n"
      "comment volalign: {}, metres; residual: distance to the labelled side\n"
      "element vertex {}\n"
      "property float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property uchar label\nproperty float confidence\nproperty float residual\nend_header\n",
      world ? "frame of " + world->name : "structure frame, y up", points.size());
  constexpr std::size_t kBytesAPoint = 24;
  bytes.reserve(bytes.size() + kBytesAPoint * points.size());
  for (const AlignedPoint& point : points) {
    Eigen::Vector3f p = point.p;
    if (world) p = (world->world_from_structure * p.cast<double>()).cast<float>();
    for (int i = 0; i < 3; ++i) Append(&bytes, p[i]);
    Append(&bytes, point.colour.r);
    Append(&bytes, point.colour.g);
    Append(&bytes, point.colour.b);
    Append(&bytes, point.label);
    Append(&bytes, point.confidence);
    Append(&bytes, point.residual);
  }
  WriteFileAtomically(path, bytes);
}

}  // namespace volalign

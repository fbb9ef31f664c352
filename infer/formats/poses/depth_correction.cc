#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/lens.h"
#include "infer/formats/poses/codecs.h"

namespace volalign::poses_internal {

namespace {

constexpr int kSteps = 2;          // within 1 m of the structure's origin, along each axis
constexpr double kNearest = 0.15;  // m: least depth of such a point

/// Points up to 1 m from the structure's origin that are before the sensor, structure frame.
std::vector<Eigen::Vector3d> PointsAround(const Pose& structure_from_sensor) {
  const Pose sensor_from_structure = structure_from_sensor.inverse();
  std::vector<Eigen::Vector3d> points;
  for (int x = -kSteps; x <= kSteps; ++x) {
    for (int y = -kSteps; y <= kSteps; ++y) {
      for (int z = -kSteps; z <= kSteps; ++z) {
        const Eigen::Vector3d q = Eigen::Vector3d(x, y, z) / kSteps;
        if (q.norm() <= 1 && (sensor_from_structure * q).z() >= kNearest) points.push_back(q);
      }
    }
  }
  return points;
}

/// A file of NumPy, float32 [height, width, 4], rows first.
std::string Npy(int height, int width, const std::vector<float>& values) {
  static_assert(sizeof(float) == 4 && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__);
  std::string header = fmt::format(
      "{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, {}, 4), }}", height, width);
  constexpr std::size_t kBegin = 10, kAligned = 64;
  header.resize((header.size() + 1 + kBegin + kAligned - 1) / kAligned * kAligned - kBegin, ' ');
  header.back() = '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size() & 0xff);
  bytes += static_cast<char>(header.size() >> 8);
  bytes += header;
  bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
  return bytes;
}

}  // namespace

ProcrustesResult PoseForRawDepth(const SensorPose& sensor) {
  std::vector<Eigen::Vector3d> raw;
  const std::vector<Eigen::Vector3d> points = PointsAround(sensor.structure_from_sensor);
  const Pose sensor_from_structure = sensor.structure_from_sensor.inverse();
  for (const Eigen::Vector3d& q : points) {
    const Eigen::Vector3d p = sensor_from_structure * q;
    raw.push_back(p * ((p.z() - sensor.depth_offset_m) / sensor.depth_gain / p.z()));
  }
  if (points.size() < 3) {
    throw ConfigError(
        fmt::format("{} does not look at the structure, so no pose of its raw depths can be found",
                    sensor.name));
  }
  return AlignPoints(raw, points);
}

double LensShift(const SensorPose& sensor) {
  if (!sensor.intrinsics || !sensor.intrinsics_given) return 0;
  const Pose sensor_from_structure = sensor.structure_from_sensor.inverse();
  double most = 0;
  for (const Eigen::Vector3d& q : PointsAround(sensor.structure_from_sensor)) {
    const Eigen::Vector3d p = sensor_from_structure * q;
    const Eigen::Vector2d ray = p.hnormalized();
    const Intrinsics& k = *sensor.intrinsics;
    const Eigen::Vector2d here = ProjectRay(k, ray),
                          there = ProjectRay(*sensor.intrinsics_given, ray);
    const bool seen = here.x() >= 0 && here.y() >= 0 && here.x() < k.width && here.y() < k.height;
    if (seen) most = std::max(most, (here - there).norm() / k.fx * p.z());
  }
  return most;
}

Files WriteDepthCorrection(const Poses& poses, const FileFrame& /*frame*/) {
  Files files;
  for (const SensorPose& pose : poses) {
    const RayTable table = ComputeRays(*pose.intrinsics);
    std::vector<float> values;
    values.reserve(4 * table.rays.size());
    for (const Eigen::Vector2f& ray : table.rays) {
      values.insert(values.end(), {ray.x(), ray.y(), static_cast<float>(pose.depth_gain),
                                   static_cast<float>(pose.depth_offset_m)});
    }
    files[pose.name + ".npy"] = Npy(table.height, table.width, values);
  }
  return files;
}

}  // namespace volalign::poses_internal

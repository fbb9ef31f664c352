#pragma once

#include <cmath>
#include <string>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "render/sample_config.h"
#include "render/scene_mesh.h"

namespace volalign {

/// The structure alone, exactly built, without noise.
inline SampleConfig BareConfig() {
  SampleConfig config;
  config.scene.room_probability = 0;
  config.scene.clutter_count = {0, 0};
  config.scene.tripod_count = {0, 0};
  config.scene.distractor_probability = 0;
  config.scene.occluder_probability = 0;
  config.assembly = {0, 0, 0};
  config.noise.models = {"none"};
  return config;
}

/// An Azure Kinect's at half size, with its lens.
inline Intrinsics HalfKinect() {
  Intrinsics k{160, 144, 126.1, 126.1, 79.3, 84.6, {}};
  k.distortion = {0.92185, 0.50040, 0, 0, 0.02836, 1.25842, 0.75181, 0.14419};
  return k;
}

inline SampleConfig SamplesOf(const std::string& sensor, const std::string& size,
                              const std::string& noise = "sensor") {
  SampleConfig config;
  config.sensors = {sensor};
  config.image_sizes = {size};
  config.noise.models = {noise};
  return config;
}

/// Whether a point of the face's plane lies in the polygon: all its edges turn the same way around
/// it.
inline bool Inside(const SceneFace& face, const Eigen::Vector3d& p, double tolerance = 0) {
  bool left = false, right = false;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d a = face.corners[k].cast<double>();
    const Eigen::Vector3d b = face.corners[(k + 1) % 4].cast<double>();
    const double side = face.normal.dot((b - a).cross(p - a));
    left |= side > tolerance;
    right |= side < -tolerance;
  }
  return !left || !right;
}

/// Whether a neighbour's label or depth differs: such pixels depend on rounding.
inline bool IsEdge(const LabelImage& labels, const DepthImage& depth, int u, int v) {
  for (int dv = -1; dv <= 1; ++dv) {
    for (int du = -1; du <= 1; ++du) {
      if (!labels.Contains(u + du, v + dv)) continue;
      if (labels(u + du, v + dv) != labels(u, v)) return true;
      if (std::abs(depth(u + du, v + dv) - depth(u, v)) > 0.2F) return true;
    }
  }
  return false;
}

}  // namespace volalign

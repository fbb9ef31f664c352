#include "render/subpixels.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/random.h"

namespace volalign {
namespace {

/// m, standard deviation of the bulge in the middle of a side. Sides of real stacks deviate by 2 to
/// 4 mm rms from a plane (docs/sensor-models.md), part of which is the sensor's error.
constexpr double kBulge = 0.002;

/// A number of the face that does not depend on the sensor.
std::uint64_t Fingerprint(const SceneFace& face) {
  std::uint64_t hash = 0;
  for (const Eigen::Vector3f& corner : face.corners) {
    for (const float x : corner) {
      hash = (hash ^ static_cast<std::uint64_t>(std::llround(1e5 * x))) * 0x100000001B3ULL;
    }
  }
  return hash;
}

}  // namespace

Subpixels::Subpixels(const NoiseInput& input) : view_(input.view) {
  const Pose sensor_from_structure = input.structure_from_sensor.inverse();
  const Eigen::Matrix3f turn = sensor_from_structure.linear().cast<float>();
  const Eigen::Vector3d eye = input.structure_from_sensor.translation();
  faces_.reserve(input.mesh.faces.size());
  for (const SceneFace& face : input.mesh.faces) {
    SeenFace seen;
    seen.normal = turn * face.normal.cast<float>();
    seen.height = static_cast<float>(face.normal.dot(eye) - face.offset);
    std::array<Eigen::Vector3f, 4> corners;
    for (std::size_t i = 0; i < 4; ++i)
      corners[i] = (sensor_from_structure * face.corners[i].cast<double>()).cast<float>();
    for (std::size_t i = 0; i < 4; ++i) {
      seen.beside[i] = corners[(i + 1) % 4].cross(corners[i]);
      // For either sense of the corners: their mean is inside, even if two of them are equal.
      const Eigen::Vector3f middle = 0.25F * (corners[0] + corners[1] + corners[2] + corners[3]);
      if (seen.beside[i].dot(middle) < 0) seen.beside[i] *= -1;
    }
    seen.corner = corners[0];
    seen.along_u = corners[1] - corners[0];
    seen.along_v = corners[3] - corners[0];
    seen.object = &input.mesh.objects[static_cast<std::size_t>(face.object)];
    seen.label = face.label;
    // Meshes are taken to be of stiffer material.
    const bool is_triangle = face.corners[2] == face.corners[3];
    if (seen.object->is_structure && !is_triangle)
      seen.bulge =
          static_cast<float>(RandomStream(Fingerprint(face), 0, "bulge").Normal(0, kBulge));
    faces_.push_back(seen);
  }
}

bool Subpixels::IsUniform(int u, int v) const {
  const Image16& faces = view_.faces;
  const std::uint16_t own = faces(u, v);
  for (int q = std::max(v - 1, 0); q <= std::min(v + 1, faces.height() - 1); ++q) {
    for (int p = std::max(u - 1, 0); p <= std::min(u + 1, faces.width() - 1); ++p) {
      if (faces(p, q) != own) return false;
    }
  }
  return true;
}

Eigen::Vector3f Subpixels::Ray(double x, double y) const {
  const RayTable& rays = *view_.rays;
  const int u = std::clamp(static_cast<int>(std::floor(x)), 0, rays.width - 2);
  const int v = std::clamp(static_cast<int>(std::floor(y)), 0, rays.height - 2);
  const auto s = static_cast<float>(x - u), t = static_cast<float>(y - v);
  const Eigen::Vector2f ray = (1 - s) * (1 - t) * rays.at(u, v) + s * (1 - t) * rays.at(u + 1, v) +
                              (1 - s) * t * rays.at(u, v + 1) + s * t * rays.at(u + 1, v + 1);
  return {ray.x(), ray.y(), 1};
}

int Subpixels::FaceAlong(const Eigen::Vector3f& ray, int u, int v) const {
  const Image16& faces = view_.faces;
  int nearest = -1;
  float least = std::numeric_limits<float>::infinity();
  for (int q = std::max(v - 1, 0); q <= std::min(v + 1, faces.height() - 1); ++q) {
    for (int p = std::max(u - 1, 0); p <= std::min(u + 1, faces.width() - 1); ++p) {
      const int index = faces(p, q) - 1;
      if (index < 0 || index == nearest) continue;
      const SeenFace& seen = face(index);
      const bool inside =
          std::all_of(seen.beside.begin(), seen.beside.end(),
                      [&](const Eigen::Vector3f& beside) { return beside.dot(ray) >= 0; });
      const float z = -seen.height / seen.normal.dot(ray);
      if (!inside || !(z > 0) || z >= least) continue;
      least = z;
      nearest = index;
    }
  }
  return nearest;
}

float Subpixels::Depth(int index, const Eigen::Vector3f& ray) const {
  const SeenFace& seen = face(index);
  const float slope = seen.normal.dot(ray), flat = -seen.height / slope;
  if (seen.bulge == 0) return flat;
  const Eigen::Vector3f from_corner = flat * ray - seen.corner;
  const auto rise = [&](const Eigen::Vector3f& along) {
    const float share = from_corner.dot(along) / along.squaredNorm();
    return std::sin(static_cast<float>(M_PI) * std::clamp(share, 0.0F, 1.0F));
  };
  return flat + seen.bulge * rise(seen.along_u) * rise(seen.along_v) / slope;
}

}  // namespace volalign

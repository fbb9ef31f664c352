#include "render/scene_mesh.h"

#include <Eigen/Geometry>
#include <cmath>

namespace volalign {
namespace {

constexpr double kLeastAcross = 1e-12;  // m^2, twice the area: of thinner triangles, no ray is hit

/// Two unit vectors that complete `axis` to a right-handed frame.
void Complete(const Eigen::Vector3d& axis, Eigen::Vector3d* u, Eigen::Vector3d* v) {
  const Eigen::Vector3d helper =
      std::abs(axis.y()) < 0.9 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitX();
  *u = helper.cross(axis).normalized();
  *v = axis.cross(*u);
}

/// Appends quads between consecutive rings of a body of revolution. They are planar, as both edges
/// of a quad are parallel.
void AppendRings(SceneMesh* mesh, const std::vector<Eigen::Vector3d>& centres,
                 const std::vector<double>& radii, const Eigen::Vector3d& u,
                 const Eigen::Vector3d& v, int segments) {
  const Eigen::Vector3d axis = u.cross(v);
  for (std::size_t ring = 0; ring + 1 < centres.size(); ++ring) {
    for (int i = 0; i < segments; ++i) {
      const double a = 2 * M_PI * i / segments;
      const double b = 2 * M_PI * (i + 1) / segments;
      const Eigen::Vector3d da = std::cos(a) * u + std::sin(a) * v;
      const Eigen::Vector3d db = std::cos(b) * u + std::sin(b) * v;
      const Eigen::Vector3d middle = (da + db).normalized();
      const double flat = std::cos(M_PI / segments);
      const double rise = axis.dot(centres[ring + 1] - centres[ring]);
      const double growth = flat * (radii[ring + 1] - radii[ring]);
      const Eigen::Vector3d normal = (rise * middle - growth * axis).normalized();
      mesh->AppendQuad(
          {centres[ring] + radii[ring] * da, centres[ring] + radii[ring] * db,
           centres[ring + 1] + radii[ring + 1] * db, centres[ring + 1] + radii[ring + 1] * da},
          normal);
    }
  }
}

}  // namespace

void SceneMesh::BeginObject(const SceneObject& object) { objects.push_back(object); }

void SceneMesh::AppendQuad(const std::array<Eigen::Vector3d, 4>& corners,
                           const Eigen::Vector3d& normal, std::uint8_t label) {
  if (objects.empty()) objects.emplace_back();
  SceneFace face;
  for (std::size_t i = 0; i < 4; ++i) face.corners[i] = corners[i].cast<float>();
  face.normal = normal;
  face.offset = normal.dot(corners[0]);
  face.label = label;
  face.object = static_cast<std::int16_t>(objects.size() - 1);
  faces.push_back(face);
}

void SceneMesh::AppendBox(const Pose& structure_from_box, const Eigen::Vector3d& size) {
  const Eigen::Matrix3d r = structure_from_box.linear();
  const Eigen::Vector3d c = structure_from_box.translation();
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d u = 0.5 * size[(axis + 1) % 3] * r.col((axis + 1) % 3);
    const Eigen::Vector3d v = 0.5 * size[(axis + 2) % 3] * r.col((axis + 2) % 3);
    for (const double sign : {1.0, -1.0}) {
      const Eigen::Vector3d normal = sign * r.col(axis);
      const Eigen::Vector3d m = c + 0.5 * size[axis] * normal;
      AppendQuad({m - u - v, m + u - v, m + u + v, m - u + v}, normal);
    }
  }
}

void SceneMesh::AppendCylinder(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                               double radius, int segments) {
  const Eigen::Vector3d axis = (to - from).normalized();
  Eigen::Vector3d u, v;
  Complete(axis, &u, &v);
  AppendRings(this, {from, to}, {radius, radius}, u, v, segments);
  for (const bool end : {false, true}) {
    const Eigen::Vector3d centre = end ? to : from;
    const Eigen::Vector3d normal = end ? axis : Eigen::Vector3d(-axis);
    for (int i = 0; i < segments; i += 2) {
      std::array<Eigen::Vector3d, 4> corners;
      corners[0] = centre;
      for (std::size_t k = 1; k <= 3; ++k) {
        const double a = 2 * M_PI * std::min(i + static_cast<int>(k) - 1, segments) / segments;
        corners[k] = centre + radius * (std::cos(a) * u + std::sin(a) * v);
      }
      AppendQuad(corners, normal);
    }
  }
}

void SceneMesh::AppendCapsule(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius,
                              int segments) {
  Eigen::Vector3d axis = to - from;
  axis = axis.norm() > 1e-9 ? Eigen::Vector3d(axis.normalized()) : Eigen::Vector3d::UnitY();
  Eigen::Vector3d u, v;
  Complete(axis, &u, &v);
  std::vector<Eigen::Vector3d> centres;
  std::vector<double> radii;
  constexpr int kCapRings = 2;
  for (int i = 0; i <= kCapRings; ++i) {
    const double a = 0.5 * M_PI * (1.0 - static_cast<double>(i) / kCapRings);
    centres.push_back(from - radius * std::sin(a) * axis);
    radii.push_back(radius * std::cos(a));
  }
  for (int i = 0; i <= kCapRings; ++i) {
    const double a = 0.5 * M_PI * i / kCapRings;
    if (i == 0 && (to - from).norm() < 1e-9) continue;
    centres.push_back(to + radius * std::sin(a) * axis);
    radii.push_back(radius * std::cos(a));
  }
  AppendRings(this, centres, radii, u, v, segments);
}

void SceneMesh::AppendSphere(const Eigen::Vector3d& centre, double radius, int segments) {
  AppendCapsule(centre, centre, radius, segments);
}

void SceneMesh::AppendStructure(const Structure& structure) {
  std::vector<std::vector<std::array<Eigen::Vector3d, 3>>> triangles;  // of a mesh, by side
  for (std::size_t i = 0; i < structure.sides().size(); ++i) {
    const Side& side = structure.sides()[i];
    const Box& part = structure.boxes()[static_cast<std::size_t>(side.box)];
    if (side.index == 0) {
      BeginObject({0.7F, 1.0F, true});
      if (part.mesh) triangles = part.TrianglesBySide();
    }
    const std::size_t first = faces.size();
    if (part.mesh) {
      for (const auto& [a, b, c] : triangles[static_cast<std::size_t>(side.index)]) {
        const Eigen::Vector3d across = (b - a).cross(c - a);
        if (across.norm() >= kLeastAcross)
          AppendQuad({a, b, c, c}, across.normalized(), side.label);
      }
    } else {
      const Eigen::Vector3d u = side.half_u * side.axis_u, v = side.half_v * side.axis_v;
      AppendQuad(
          {side.centre - u - v, side.centre + u - v, side.centre + u + v, side.centre - u + v},
          side.normal, side.label);
    }
    for (std::size_t k = first; k < faces.size(); ++k) faces[k].side = static_cast<int>(i);
  }
}

}  // namespace volalign

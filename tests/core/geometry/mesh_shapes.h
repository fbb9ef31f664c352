#pragma once

// Closed meshes as targets, and their files.

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/part_mesh.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::mesh_shapes {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// The surface of a part; solids in it may touch.
struct Solid {
  std::string name;
  std::vector<Vector3d> vertices;
  std::vector<PartMesh::Triangle> triangles;

  void Add(const Solid& other) {
    const auto first = static_cast<int>(vertices.size());
    vertices.insert(vertices.end(), other.vertices.begin(), other.vertices.end());
    for (const auto& t : other.triangles)
      triangles.push_back({first + t[0], first + t[1], first + t[2]});
  }
};

/// An object of one or more parts.
struct Shape {
  std::string name;
  std::vector<Solid> parts;
};

/// A polygon in the plane of the two axes after `axis`, anticlockwise, all of which is seen from
/// its first corner, drawn from `low` to `high` along it.
inline Solid Extruded(int axis, const std::vector<Vector2d>& polygon, double low, double high) {
  Solid solid;
  const auto n = static_cast<int>(polygon.size());
  for (const double along : {low, high}) {
    for (const Vector2d& p : polygon) {
      Vector3d& vertex = solid.vertices.emplace_back();
      vertex[axis] = along;
      vertex[(axis + 1) % 3] = p.x();
      vertex[(axis + 2) % 3] = p.y();
    }
  }
  for (int i = 1; i + 1 < n; ++i) {
    solid.triangles.push_back({n, n + i, n + i + 1});
    solid.triangles.push_back({0, i + 1, i});
  }
  for (int i = 0; i < n; ++i) {
    const int j = (i + 1) % n;
    solid.triangles.push_back({i, j, j + n});
    solid.triangles.push_back({i, j + n, i + n});
  }
  return solid;
}

inline Solid Cuboid(const Vector3d& low, const Vector3d& high) {
  return Extruded(
      2, {{low.x(), low.y()}, {high.x(), low.y()}, {high.x(), high.y()}, {low.x(), high.y()}},
      low.z(), high.z());
}

/// Upright; `foot`: the middle of its lower end.
inline Solid Cylinder(const Vector3d& foot, double radius, double height, int segments) {
  std::vector<Vector2d> circle;  // z, x
  for (int i = 0; i < segments; ++i) {
    const double a = 2 * M_PI * i / segments;
    circle.emplace_back(foot.z() + radius * std::cos(a), foot.x() + radius * std::sin(a));
  }
  return Extruded(1, circle, foot.y(), foot.y() + height);
}

/// One part of solids.
inline Solid Joined(const std::string& name, const std::vector<Solid>& solids) {
  Solid all;
  all.name = name;
  for (const Solid& solid : solids) all.Add(solid);
  return all;
}

/// Puts the middle of the box around it at the origin, as that of the paper's stack is.
inline Shape Centred(Shape shape) {
  Eigen::AlignedBox3d bounds;
  for (const Solid& part : shape.parts)
    for (const Vector3d& p : part.vertices) bounds.extend(p);
  for (Solid& part : shape.parts)
    for (Vector3d& p : part.vertices) p -= bounds.center();
  return shape;
}

/// Of one part.
inline Shape OnePart(const std::string& name, const std::vector<Solid>& solids) {
  return Centred({name, {Joined(name, solids)}});
}

inline Shape Ell() {
  return OnePart(
      "ell",
      {Extruded(2, {{0, 0}, {0.9, 0}, {0.9, 0.3}, {0.35, 0.3}, {0.35, 0.8}, {0, 0.8}}, 0, 0.5)});
}

inline Shape Wedge() {
  return OnePart("wedge", {Extruded(2, {{0, 0}, {0.8, 0}, {0, 0.6}}, 0, 0.5)});
}

/// It looks the same after half a turn.
inline Shape Table() {
  std::vector<Solid> solids{Cuboid({-0.6, 0.71, -0.35}, {0.6, 0.75, 0.35})};
  for (const double x : {-0.53, 0.53})
    for (const double z : {-0.28, 0.28})
      solids.push_back(Cuboid({x - 0.03, 0, z - 0.03}, {x + 0.03, 0.71, z + 0.03}));
  return OnePart("table", solids);
}

inline Shape Shelf() {
  std::vector<Solid> solids{Cuboid({-0.175, 0, -0.4}, {0.175, 1.6, -0.36}),
                            Cuboid({-0.175, 0, 0.36}, {0.175, 1.6, 0.4}),
                            Cuboid({-0.195, 0, -0.4}, {-0.175, 1.6, 0.4})};
  for (const double y : {0.06, 0.5, 0.95, 1.4})
    solids.push_back(Cuboid({-0.175, y, -0.36}, {0.175, y + 0.04, 0.36}));
  return OnePart("shelf", solids);
}

inline Shape Stool() {
  std::vector<Vector2d> steps{{0, 0}, {0.75, 0}};
  for (const double x : {0.75, 0.5, 0.25}) {
    steps.emplace_back(x, 1 - x);
    steps.emplace_back(x - 0.25, 1 - x);
  }
  return OnePart("stool", {Extruded(2, steps, 0, 0.45)});
}

/// With rounded upper edges, a round chimney, and a box at its front.
inline Shape Housing() {
  constexpr double kWidth = 1.0, kHeight = 0.8, kRadius = 0.1;
  constexpr int kStrips = 6;
  std::vector<Vector2d> profile{{0, 0}, {kWidth, 0}};
  for (const bool left : {false, true}) {
    for (int i = 0; i <= kStrips; ++i) {
      const double a = M_PI / 2 * (i / static_cast<double>(kStrips) + (left ? 1 : 0));
      profile.emplace_back((left ? kRadius : kWidth - kRadius) + kRadius * std::cos(a),
                           kHeight - kRadius + kRadius * std::sin(a));
    }
  }
  return OnePart("housing",
                 {Extruded(2, profile, 0, 0.7), Cylinder({0.3, kHeight, 0.25}, 0.1, 0.4, 32),
                  Cuboid({kWidth, 0.25, 0.1}, {kWidth + 0.2, 0.6, 0.4})});
}

/// Each box is a part.
inline Shape Chair() {
  Shape shape{"chair",
              {Joined("seat", {Cuboid({-0.22, 0.42, -0.22}, {0.22, 0.46, 0.22})}),
               Joined("back", {Cuboid({-0.22, 0.46, -0.22}, {-0.18, 0.95, 0.22})})}};
  for (const double x : {-0.2, 0.2})
    for (const double z : {-0.2, 0.2})
      shape.parts.push_back(
          Joined(fmt::format("{}_{}_leg", x > 0 ? "front" : "back", z > 0 ? "right" : "left"),
                 {Cuboid({x - 0.02, 0, z - 0.02}, {x + 0.02, 0.42, z + 0.02})}));
  return Centred(std::move(shape));
}

/// The stack of configs/structure.yaml: four parts.
inline Shape Stack() {
  Shape shape{"stack", {}};
  const Structure structure = ReadStructure("configs/structure.yaml");
  for (const Box& box : structure.boxes()) {
    const Vector3d middle = box.structure_from_box.translation();
    shape.parts.push_back(Joined(box.name, {Cuboid(middle - box.size / 2, middle + box.size / 2)}));
  }
  return shape;
}

inline Shape Lectern() {
  return OnePart(
      "lectern",
      {Cuboid({-0.3, 0, -0.25}, {0.3, 0.05, 0.25}),
       Extruded(2, {{-0.15, 0.05}, {0.15, 0.05}, {0.15, 0.9}, {-0.15, 1.05}}, -0.15, 0.15),
       Extruded(2, {{0.35, 0.8}, {0.35, 0.85}, {-0.25, 1.15}, {-0.25, 1.1}}, -0.3, 0.3)});
}

inline Shape StackAndCylinder() {
  return OnePart("stack_and_cylinder", {Cuboid({-0.3, 0, -0.25}, {0.3, 0.4, 0.25}),
                                        Cuboid({-0.3, 0.4, -0.25}, {0.1, 0.75, 0.05}),
                                        Cylinder({0.15, 0, 0.5}, 0.14, 0.6, 40)});
}

/// 0.4 to 1.6 m.
inline std::vector<Shape> TenShapes() {
  return {Ell(),     Wedge(), Table(), Shelf(),   Stool(),
          Housing(), Chair(), Stack(), Lectern(), StackAndCylinder()};
}

inline Structure StructureOf(const Shape& shape) {
  std::vector<Box> parts;
  for (const Solid& part : shape.parts)
    parts.push_back(Box::FromMesh(part.name, PartMesh::Make(part.vertices, part.triangles)));
  return Structure::FromBoxes(shape.name, std::move(parts));
}

/// Five of 10 to 50 cm at any yaw and tilt that overlap and hang over each other, as meshes or not.
inline Structure RandomCuboids(std::uint64_t index, bool meshes = false) {
  RandomStream random(4, index, "boxes");
  const auto draw = [&] { return Vector3d{random.Normal(), random.Normal(), random.Normal()}; };
  std::vector<Box> boxes;
  for (int b = 0; b < 5; ++b) {
    const std::string name = "box" + std::to_string(b);
    const Vector3d half{random.Uniform(0.05, 0.25), random.Uniform(0.05, 0.25),
                        random.Uniform(0.05, 0.25)};
    const Solid solid = Cuboid(-half, half);
    boxes.push_back(meshes ? Box::FromMesh(name, PartMesh::Make(solid.vertices, solid.triangles))
                           : Box::FromMinMax(name, -half, half));
    boxes.back().structure_from_box.translation() = 0.3 * draw();
    boxes.back().structure_from_box.linear() = RotationExp(draw());
  }
  return Structure::FromBoxes("random", boxes);
}

inline std::string Obj(const Shape& shape) {
  std::string text;
  int first = 1;
  for (const Solid& part : shape.parts) {
    text += "o " + part.name + "\n";
    for (const Vector3d& p : part.vertices)
      text += fmt::format("v {:.9g} {:.9g} {:.9g}\n", p.x(), p.y(), p.z());
    for (const auto& t : part.triangles)
      text += fmt::format("f {} {} {}\n", first + t[0], first + t[1], first + t[2]);
    first += static_cast<int>(part.vertices.size());
  }
  return text;
}

inline std::filesystem::path WriteObj(const TempFolder& folder, const Shape& shape) {
  return folder.Write(shape.name + ".obj", Obj(shape));
}

}  // namespace volalign::mesh_shapes

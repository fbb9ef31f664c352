#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"

namespace volalign {

/// A convex planar polygon with three or four corners, in the structure frame, m. It is seen from
/// the side to which `normal` points.
struct SceneFace {
  std::array<Eigen::Vector3f, 4> corners;  ///< a triangle repeats its last corner
  Eigen::Vector3d normal;                  ///< unit
  double offset = 0;                       ///< normal . p for every p of the plane, m
  std::uint8_t label = 0;
  std::int16_t object = 0;  ///< index into SceneMesh::objects
  std::int32_t side = -1;   ///< index into Structure::sides(); -1: not of the structure
};

/// The properties of a physical object for a depth sensor.
struct SceneObject {
  /// Share of infrared light that returns, 0 to 1. Time-of-flight sensors lose dark objects.
  float reflectivity = 0.6F;
  /// Texture for a stereo matcher, from 0 (plain) to 1.
  float texture = 1.0F;
  bool is_structure = false;
};

/// Faces to draw. Everything is closed and seen from outside, except rooms, which are seen from
/// inside.
struct SceneMesh {
  std::vector<SceneFace> faces;
  std::vector<SceneObject> objects;

  /// Starts a new object, to which the next faces belong.
  void BeginObject(const SceneObject& object);

  /// `corners`: four coplanar ones, in order around `normal` (unit).
  void AppendQuad(const std::array<Eigen::Vector3d, 4>& corners, const Eigen::Vector3d& normal,
                  std::uint8_t label = 0);
  /// A box of `size` along the axes of its frame and centred at its origin.
  void AppendBox(const Pose& structure_from_box, const Eigen::Vector3d& size);
  /// An upright or slanted round bar between two points, with flat ends.
  void AppendCylinder(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius,
                      int segments);
  /// A ball, stretched along `axis` (length included: a capsule from `from` to `to`).
  void AppendCapsule(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius,
                     int segments);
  void AppendSphere(const Eigen::Vector3d& centre, double radius, int segments);
  /// All sides with their labels; those without one are solid background. Each part is an object.
  void AppendStructure(const Structure& structure);
};

}  // namespace volalign

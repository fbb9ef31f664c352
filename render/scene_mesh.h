#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"

namespace volalign {

/// A convex planar polygon of three or four corners, in the structure frame, m. It is seen from the
/// side that `normal` points to.
struct SceneFace {
  std::array<Eigen::Vector3f, 4> corners;  ///< a triangle repeats its last corner
  Eigen::Vector3d normal;                  ///< unit
  double offset = 0;                       ///< normal . p for every p of the plane, m
  std::uint8_t label = 0;
  std::int16_t object = 0;  ///< index into SceneMesh::objects
};

/// What a physical object is to a depth sensor.
struct SceneObject {
  /// Share of infrared light that comes back, 0 to 1 (time-of-flight sensors lose what is dark).
  float reflectivity = 0.6F;
  /// How much a stereo matcher finds to hold on to, 0 (plain) to 1.
  float texture = 1.0F;
  bool is_structure = false;
};

/// Faces to draw. Everything is closed and seen from outside, apart from rooms, which are seen from
/// inside.
struct SceneMesh {
  std::vector<SceneFace> faces;
  std::vector<SceneObject> objects;

  /// Starts a new object; the faces appended next belong to it.
  void BeginObject(const SceneObject& object);

  /// Four corners in order around `normal` (unit), coplanar.
  void AppendQuad(const std::array<Eigen::Vector3d, 4>& corners, const Eigen::Vector3d& normal,
                  std::uint8_t label = 0);
  /// A box of `size` along the axes of its frame, centred there.
  void AppendBox(const Pose& structure_from_box, const Eigen::Vector3d& size);
  /// An upright or slanted round bar between two points, with flat ends.
  void AppendCylinder(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius,
                      int segments);
  /// A ball, stretched along `axis` (length included: a capsule from `from` to `to`).
  void AppendCapsule(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius,
                     int segments);
  void AppendSphere(const Eigen::Vector3d& centre, double radius, int segments);
  /// All sides with their labels; `down` sides are solid background.
  void AppendStructure(const Structure& structure);
};

}  // namespace volalign

#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/base/image.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A measured point with the surface around it. Sensor frame, metres.
struct OrientedPoint {
  Eigen::Vector3d p;
  Eigen::Vector3d normal;  ///< unit, towards the sensor
  double area = 0;         ///< m^2, of the surface that the point stands for
};

/// Normal of the surface around a pixel, unit, towards the sensor. It is that of the plane through
/// the neighbours within about 4 cm on the same surface. Zero where too few of them were measured
/// or they lie on no plane.
Eigen::Vector3d NormalAt(const SensorView& view, int u, int v);

/// A view with fewer rays, and the normals that the full view shows there.
struct SensorSurface {
  SensorView view;
  Image<Eigen::Vector3f> normals;  ///< as NormalAt has them
  /// 1: the pixel lies on a plane of the room, not on the structure; see MarkRoom.
  Image<std::uint8_t> room;
};
SensorSurface MakeSensorSurface(const SensorView& view, double rays);
SensorSurface Decimate(const SensorSurface& surface, int stride);

/// The points that have a normal, without those of the room.
std::vector<OrientedPoint> PointsOf(const SensorSurface& surface);

/// A plane of the room: a floor, a wall, a table, a side of a large box.
struct RoomPlane {
  Eigen::Vector3d normal;  ///< unit, towards the sensor
  double offset = 0;       ///< normal . p of its points, m; negative
  double area = 0;         ///< m^2, seen
};

/// The planes on which most points lie, at most `most`, the largest area first. Deterministic.
/// `errors`: of the sensor that measured the points.
std::vector<RoomPlane> FindRoomPlanes(const std::vector<OrientedPoint>& points, int most,
                                      const DepthErrorModel& errors);

/// Marks the pixels on planes larger than `largest` m^2, on their connected parts that are larger
/// too. A smaller part may be a side of a box that happens to lie in the same plane.
void MarkRoom(const std::vector<RoomPlane>& planes, double largest, SensorSurface* surface);

}  // namespace volalign

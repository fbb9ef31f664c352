#pragma once

#include <optional>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/aliases.h"
#include "infer/initial/oriented_points.h"
#include "infer/initial/view_fit.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A pose that explains a view by its shape.
struct GeometricPose {
  Pose structure_from_sensor = Pose::Identity();
  ViewFit shape;
};

/// A view as structures are searched for in it. Planes that are larger than any of the structure's
/// are the room's.
struct SurfaceInRoom {
  SensorSurface surface, first_look;  ///< with about kCoarseRays rays, and with fewer
  std::vector<RoomPlane> planes;
  std::vector<OrientedPoint> points, floor_points;  ///< without those of the room, and with them
};
SurfaceInRoom LookAround(const SensorView& view, const Structure& structure);

/// Its surface, as MeasureShape wants it.
SensorSurface PrepareSurface(const SensorView& view, const Structure& structure);

/// Is it more probable than not that a view shows the structure at this pose?
inline bool HasShape(const ViewFit& shape) { return shape.LogOdds() > 0; }

/// The poses at which the structure has the shape of what a view shows, the best first, without any
/// labels: each that explains it about as well as the best one, symmetric ones among them. Empty
/// where the structure is not seen.
///
/// The structure is searched for on every large plane that may be a floor (stack_search.h). Where
/// that finds nothing, it is searched for on the other planes, as on a table, and without any:
/// up is then taken from the directions in which surfaces face, and the height is searched as
/// well. The best candidates are brought onto the boxes (box_fit.h) and verified (view_fit.h).
std::vector<GeometricPose> FindPosesByGeometry(const SensorView& view, const Structure& structure,
                                               const std::vector<StructureAlias>& aliases);

/// The pose at which most of a structure is seen, and least contradicts it, on any plane that may
/// be a floor, whether or not it has the structure's shape: of a search that is some ten times as
/// fast, for one structure after another. Nothing where no floor is seen.
std::optional<GeometricPose> FindBestOnFloors(const SurfaceInRoom& view,
                                              const Structure& structure);

/// The candidates of that search before it is asked whether they have the structure's shape, on the
/// floors first, without aliases.
std::vector<GeometricPose> FindCandidatesByGeometry(const SensorView& view,
                                                    const Structure& structure);

}  // namespace volalign

#pragma once

#include <optional>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/oriented_points.h"
#include "infer/initial/symmetries.h"
#include "infer/initial/view_fit.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A pose that explains a view by its shape.
struct GeometricPose {
  Pose structure_from_sensor = Pose::Identity();
  ViewFit shape;
};

/// A view prepared for the search. Planes larger than any of the structure's belong to the room.
struct SurfaceInRoom {
  SensorSurface surface, first_look;  ///< about kCoarseRays rays, and fewer
  std::vector<RoomPlane> planes;
  std::vector<OrientedPoint> points, floor_points;  ///< without and with the room's
};
SurfaceInRoom LookAround(const SensorView& view, const Structure& structure);

/// Is it more probable than not that the view shows the structure at this pose?
inline bool HasShape(const ViewFit& shape) { return shape.LogOdds() > 0; }

/// Finds the poses at which the structure has the shape that the view shows, without labels, the
/// best first. Every pose that explains the view about as well as the best one is among them,
/// symmetric ones too. Empty where the structure is not seen.
///
/// The structure is searched for on every large plane that may be a floor (stack_search.h). If the
/// best pose there has less than kDecisiveOdds, the search goes on with the other planes, as of
/// tables, and without a plane. Up is then taken from the directions in which surfaces face, and
/// the height is searched too. The best candidates are brought onto the boxes (box_fit.h) and
/// verified (view_fit.h).
std::vector<GeometricPose> FindPosesByGeometry(const SensorView& view, const Structure& structure,
                                               const std::vector<StructureSymmetry>& symmetries);

/// The pose on a floor, else on a table, with the largest ViewFit::Gain, whether or not the
/// structure has its shape there. The search is coarser and some ten times as fast, for one
/// structure after another. Nothing where no floor is seen.
std::optional<GeometricPose> FindBestOnFloors(const SurfaceInRoom& view,
                                              const Structure& structure);

/// ViewFit::LogOdds of a pose that geometry found and that was refined since. Nothing if the shape
/// (by kDecisiveOdds), the floor or a tilted side refutes it. This check is closer than the search:
/// other boxes may have the structure's outline to a few centimetres, but their sides face
/// otherwise.
std::optional<double> ShapeLogOdds(const SensorView& view, const Structure& structure,
                                   const Pose& structure_from_sensor);

}  // namespace volalign

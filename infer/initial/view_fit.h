#pragma once

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/oriented_points.h"

namespace volalign {

/// How well what was measured has the structure's shape at a pose, whatever any label says: areas,
/// m^2, of the structure's surface as it would be seen from there, of what is seen at more than 60
/// deg at most twice the area across the rays.
struct ViewFit {
  double explained = 0;  ///< measured there, facing as it should
  double turned = 0;     ///< measured there, but facing otherwise
  /// Measured there, but part of something larger: a plane of the room, or a side whose
  /// surroundings go on more than they end.
  double larger = 0;
  double behind = 0;    ///< something behind was measured, which contradicts the pose
  double occluded = 0;  ///< something in front was measured
  // Just beyond the borders of the sides, where nothing of the structure is.
  double goes_on = 0;  ///< the surface goes on there, which contradicts the pose
  double ends = 0;     ///< something behind was measured, or nothing
  /// Different planes of the structure: of sides, and of faces behind a side's edge, which is seen
  /// because the side ends there. Those that the pose shows, those of them that nothing in front
  /// hides, and those of these that were found. What leaves k of them to coincidence is found once
  /// in so many places, the larger k the rarer.
  int shown_planes = 0, open_planes = 0, found_planes = 0;

  double explained_share() const { return Share(explained, behind + larger + turned / 2); }
  double visible_share() const { return Share(explained, occluded); }
  double goes_on_share() const { return Share(goes_on, ends); }
  /// Of the planes that nothing hides, those that were found. So many of the shown ones count as
  /// not hidden at least, as a share: behind something near, too much would be taken for hidden.
  double planes_share(double least_open) const;
  /// Intersection over union of the structure and of what looks like it: `reference`, m^2, which is
  /// the most that any pose explains.
  double shape_iou(double reference) const {
    const double more = reference > explained ? reference - explained : 0;
    return Share(explained, more + behind + larger + (turned + goes_on) / 2);
  }

 private:
  static double Share(double part, double rest) {
    return part + rest > 0 ? part / (part + rest) : 0;
  }
};

ViewFit MeasureShape(const SensorSurface& surface, const Structure& structure,
                     const Pose& structure_from_sensor);

}  // namespace volalign

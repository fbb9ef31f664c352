#pragma once

#include "core/pose.h"
#include "core/structure.h"
#include "infer/pose/oriented_points.h"

namespace volalign {

/// How well what was measured has the structure's shape at a pose, whatever any label says: areas,
/// m^2, of the structure's surface as it would be seen from there.
struct ShapeEvidence {
  double explained = 0;  ///< measured there, facing as it should
  double turned = 0;     ///< measured there, but facing otherwise
  /// Measured there, but part of something larger: a plane of the room, or a side whose
  /// surroundings go on more than they end.
  double larger = 0;
  double see_through = 0;  ///< something behind was measured, which contradicts the pose
  double occluded = 0;     ///< something in front was measured
  // Just beyond the borders of the sides, where nothing of the structure is.
  double goes_on = 0;  ///< the surface goes on there, which contradicts the pose
  double ends = 0;     ///< something behind was measured, or nothing
  /// Different planes of the structure that the view shows: of sides that were measured, and of
  /// those whose edge was, because what is before it ends there. What leaves k of them to
  /// coincidence is found once in so many places, the larger k the rarer.
  int planes = 0;

  double explained_share() const { return Share(explained, see_through + larger + turned / 2); }
  double visible_share() const { return Share(explained, occluded); }
  double goes_on_share() const { return Share(goes_on, ends); }
  /// Intersection over union of the structure and of what looks like it: `reference`, m^2, which is
  /// the most that any pose explains.
  double overlap(double reference) const {
    const double more = reference > explained ? reference - explained : 0;
    return Share(explained, more + see_through + larger + (turned + goes_on) / 2);
  }

 private:
  static double Share(double part, double rest) {
    return part + rest > 0 ? part / (part + rest) : 0;
  }
};

ShapeEvidence MeasureShape(const SurfaceView& surface, const Structure& structure,
                           const Pose& structure_from_sensor);

}  // namespace volalign

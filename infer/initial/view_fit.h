#pragma once

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/oriented_points.h"

namespace volalign {

/// Agreement of a view with the structure's shape at a pose, whatever any label says. The areas,
/// m^2, are of the structure's surface as seen from the pose. A surface seen at a grazing angle of
/// more than 60 deg counts as twice its area across the rays.
struct ViewFit {
  double explained = 0;  ///< measured there, facing as it should
  double turned = 0;     ///< measured there, but facing otherwise
  /// Measured there, but part of a plane of the room, or of a side that goes on beyond its borders
  /// more than it ends there.
  double larger = 0;
  double behind = 0;  ///< something behind was measured, which contradicts the pose
  // Just beyond the borders of the sides, where the structure has nothing:
  double goes_on = 0;  ///< the surface goes on there, which contradicts the pose
  double ends = 0;     ///< something behind was measured, or nothing
  /// Different planes of the structure: of sides, and of faces behind a side's edge. Such a face is
  /// found where the side ends. `open_planes`: shown at the pose with nothing in front.
  int open_planes = 0, found_planes = 0;
  double surface = 0;  ///< of the sides that labels name, seen or not

  /// Measured where the structure should be, but something else.
  double contradicted() const { return behind + larger + turned / 2; }
  /// Explained area less contradictions, m^2.
  double Gain() const { return explained - behind - larger - (turned + goes_on) / 2; }
  /// Natural logarithm of the odds that the structure stands there. The alternative is a pose of
  /// other boxes, or beside the structure, that a search comes upon; both are equally probable
  /// before.
  double LogOdds() const;
};

ViewFit MeasureShape(const SensorSurface& surface, const Structure& structure,
                     const Pose& structure_from_sensor);

}  // namespace volalign

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
  double behind = 0;  ///< something behind was measured, which contradicts the pose
  // Just beyond the borders of the sides, where nothing of the structure is.
  double goes_on = 0;  ///< the surface goes on there, which contradicts the pose
  double ends = 0;     ///< something behind was measured, or nothing
  /// Different planes of the structure: of sides, and of faces behind a side's edge, which is seen
  /// because the side ends there. Those that the pose shows and nothing in front hides, and those
  /// of them that were found.
  int open_planes = 0, found_planes = 0;
  double surface = 0;  ///< of the sides that labels name, seen or not

  /// What was measured where the structure is, and is not it.
  double contradicted() const { return behind + larger + turned / 2; }
  /// What a pose explains, less what contradicts it, m^2.
  double Gain() const { return explained - behind - larger - (turned + goes_on) / 2; }
  /// Natural logarithm of the odds that the structure stands there, to a pose of other boxes or
  /// beside it that a search comes upon; both being equally probable before.
  double LogOdds() const;
};

ViewFit MeasureShape(const SensorSurface& surface, const Structure& structure,
                     const Pose& structure_from_sensor);

}  // namespace volalign

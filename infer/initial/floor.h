#pragma once

#include <algorithm>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/aliases.h"
#include "infer/view/alike.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Does the structure stand on a floor at this pose? A stack of boxes can look the same upside down
/// (the paper's is unchanged, to 5 mm, by half a turn about a horizontal diagonal), so its labels
/// and depths alone do not tell up from down. What lies around it does. A floor is level: at a pose
/// that is off by a box, an upright side of the structure itself may reach down to where the floor
/// would be.
///
/// The structure may stand on a table. What is seen between its foot and a level surface far under
/// it speaks against nothing then, and neither does what is seen past a level surface that lies
/// beside its foot.
struct FloorFit {
  int pixels = 0;    ///< with depth, of those that a picture of kCoarseRays has
  int on_floor = 0;  ///< of those: level, on the plane that the structure stands on, off the
                     ///< structure
  /// Of those: clearly under that plane, or under the floor that a table may stand on, where no
  /// true pose has any.
  int below = 0;
  /// Of those on the plane, what lies beside the structure's foot; of those below, those whose rays
  /// pass the plane there or under the structure.
  int beside = 0, passing = 0;
  double cells = 0;  ///< independent cells of the pixels with depth
  /// Is a level surface seen beside the foot, that of a floor or of a table?
  bool HasSupport() const { return beside > kLeastShown * (beside + passing); }
  int balance() const {
    const int of_all = on_floor - 2 * below;
    return HasSupport() ? std::max(of_all, beside) : of_all;
  }
  /// Does the structure stand on that floor? Natural logarithm of the odds, by how much of the view
  /// lies on it, and by what lies under it. 0 where no pixel has depth.
  double LogOdds() const;
  /// Is so much clearly under the foot, and beside the foot nothing that would carry it, that the
  /// structure cannot stand there? By odds of kDecisiveOdds.
  bool Floats() const;

 private:
  double LogOddsByBelow() const;
};
FloorFit FindFloor(const SensorView& view, const Structure& structure,
                   const Pose& structure_from_sensor);
/// Of poses that compete: what lies on the structure at any of them is no floor, since one that is
/// off by a box may have a level side of it where the floor would be.
std::vector<FloorFit> FindFloors(const SensorView& view, const Structure& structure,
                                 const std::vector<Pose>& poses);

/// By how much the floor speaks for a pose rather than for any alias of it: the least difference of
/// FloorFit::LogOdds; infinity without aliases.
double FloorMargin(const SensorView& view, const Structure& structure,
                   const std::vector<StructureAlias>& aliases, const Pose& structure_from_sensor);

}  // namespace volalign

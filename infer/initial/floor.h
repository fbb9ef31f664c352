#pragma once

#include <algorithm>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/symmetries.h"
#include "infer/view/alike.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Does the structure stand on a floor at this pose? A stack of boxes can look the same upside
/// down. The paper's stack is unchanged, to 5 mm, by half a turn about a horizontal diagonal. Its
/// labels and depths alone then do not tell up from down, but its surroundings do. A floor has to
/// be level: at a pose that is off by a box, an upright side may reach down to the floor's place.
///
/// The structure may stand on a table. Points between its foot and a level surface far below then
/// say nothing, and neither do points seen past a level surface beside its foot.
struct FloorFit {
  int pixels = 0;    ///< pixels with depth, among about kCoarseRays
  int on_floor = 0;  ///< level pixels off the structure, on the plane of its foot
  /// Pixels clearly under that plane, or under the floor that a table may stand on. A true pose has
  /// none.
  int below = 0;
  /// `beside`: of on_floor, those near the foot. `passing`: of below, those whose rays pass the
  /// plane near or under the structure.
  int beside = 0, passing = 0;
  double cells = 0;  ///< independent cells among these pixels
  /// Is a level surface, of a floor or a table, seen beside the foot?
  bool HasSupport() const { return beside > kLeastShown * (beside + passing); }
  int balance() const {
    const int of_all = on_floor - 2 * below;
    return HasSupport() ? std::max(of_all, beside) : of_all;
  }
  /// Natural logarithm of the odds that the structure stands on that floor, by the shares of the
  /// view that lie on it and under it. 0 where no pixel has depth.
  double LogOdds() const;
  /// Can the structure not stand there, by odds of kDecisiveOdds? Much is then seen clearly under
  /// its foot, and nothing beside its foot would carry it.
  bool Floats() const;

 private:
  double LogOddsByBelow() const;
};
FloorFit FindFloor(const SensorView& view, const Structure& structure,
                   const Pose& structure_from_sensor);
/// The same of competing poses. A point that lies on the structure at any of them is no floor. A
/// pose that is off by a box may have a level side at the floor's place.
std::vector<FloorFit> FindFloors(const SensorView& view, const Structure& structure,
                                 const std::vector<Pose>& poses);

/// The evidence of the floor for a pose rather than for any symmetry of it: the least difference of
/// FloorFit::LogOdds; infinity without symmetries.
double FloorMargin(const SensorView& view, const Structure& structure,
                   const std::vector<StructureSymmetry>& symmetries,
                   const Pose& structure_from_sensor);

}  // namespace volalign

#pragma once

#include <vector>

#include "core/geometry/structure.h"
#include "infer/initial/oriented_points.h"
#include "infer/initial/stack_search.h"

namespace volalign {

/// One guess for each plane on which the structure may stand, those that most of the view lies on
/// first: of floors, behind which few points lie, or of tables, behind which more do.
std::vector<StandingGuess> GuessFloors(const std::vector<RoomPlane>& planes, bool tables);

/// Where no floor is seen, or nothing stands on it: up is one of the
/// directions in which planes face, or at a right angle to two of them; the structure's sides face
/// as the other planes do; and one of its tops is as high as a surface that faces up, or, where
/// none does, at any height at which something was measured. `usual`: directions, sensor frame, in
/// which up may be, to 35 deg; where only planes of one direction are seen, up is as these are, as
/// far as the planes are upright.
/// `points`: without those of the room, and `small` the planes among them, as which the structure's
/// sides may face; `planes`: all.
std::vector<StandingGuess> GuessWithoutFloor(const std::vector<OrientedPoint>& points,
                                             const std::vector<RoomPlane>& planes,
                                             const std::vector<RoomPlane>& small,
                                             const Structure& structure,
                                             const StackOutline& outline,
                                             const std::vector<Eigen::Vector3d>& usual);

}  // namespace volalign

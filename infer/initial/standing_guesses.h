#pragma once

#include <vector>

#include "core/geometry/structure.h"
#include "infer/initial/oriented_points.h"
#include "infer/initial/stack_search.h"

namespace volalign {

/// Guesses where no floor is seen, or nothing stands on it. Up is one of the directions in which
/// planes face, or at a right angle to two of them. The structure's sides face as the planes of
/// `small` do. One of its tops is as high as a surface that faces up. Where no surface does, every
/// height with points is tried. `usual`: directions, sensor frame; the part of each along a plane
/// within 30 deg of it may be up too. `points`: without those of the room. `planes`: of all points;
/// `small`: of `points`.
std::vector<StandingGuess> GuessWithoutFloor(const std::vector<OrientedPoint>& points,
                                             const std::vector<RoomPlane>& planes,
                                             const std::vector<RoomPlane>& small,
                                             const Structure& structure,
                                             const StackOutline& outline,
                                             const std::vector<Eigen::Vector3d>& usual);

}  // namespace volalign

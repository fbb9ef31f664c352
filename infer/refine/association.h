#pragma once

// Which point of a sensor belongs to which part of the structure. Not for callers of Refine.

#include <Eigen/Core>

#include "core/geometry/structure.h"
#include "infer/refine/parameters.h"
#include "infer/refine/sensor_points.h"

namespace volalign::refine_internal {

/// The nearest edge of the side within `gate`, m, of a silhouette point p: an index of
/// Side::BorderAt. The edge's direction has to agree with `outward`. Structure frame. -1 if there
/// is none.
int NearestEdge(const Side& side, const Eigen::Vector3d& p, const Eigen::Vector3d& outward,
                double gate);

/// Does a labelled point lie within `gate`, m, of its side, and does its normal agree? False if the
/// point is not finite.
bool LiesOnItsSide(const Structure& structure, const FrameState& sensor, const SidePoint& point,
                   double gate);

/// The edge of its side that a silhouette point lies on, within `gate`, m. -1 if there is none.
int EdgeUnder(const Structure& structure, const FrameState& sensor, const EdgePoint& edge,
              double gate);

}  // namespace volalign::refine_internal

#pragma once

// Which point of a sensor belongs to which part of the structure. Not for callers of Refine.

#include <Eigen/Core>

#include "core/geometry/structure.h"
#include "infer/refine/parameters.h"
#include "infer/refine/sensor_points.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

/// How near things have to be to be taken for the same. Overlap that is to hold poses, where the
/// structure does not, may be farther apart: pair_overlap.cc.
struct Gates {
  double side = 2 * kRoughPose;   ///< m, distance of a labelled point to its side
  double overlap = kSamePlace;    ///< m, distance of matched points of two sensors
  double min_cosine = kOnePlane;  ///< between their normals
};

/// One of the four edge lines of a side: direction . p = offset, direction pointing out of the
/// side.
struct EdgeLine {
  Eigen::Vector3d direction;
  double offset;
  int edge;  ///< 0 ... 3: +u, -u, +v, -v
};

/// The edge of the side that a silhouette point at p belongs to: the nearest within `gate`, m,
/// whose direction agrees with `outward`. Structure frame.
bool NearestEdge(const Side& side, const Eigen::Vector3d& p, const Eigen::Vector3d& outward,
                 double gate, EdgeLine* line);

/// Does a labelled point lie on the side that it is labelled with, within `gate`, m, and face as it
/// does? A point that is not finite does not.
bool LiesOnItsSide(const Structure& structure, const FrameState& sensor, const SidePoint& point,
                   double gate);

/// Does a silhouette point lie on an edge of its side, and on which?
bool LiesOnAnEdge(const Structure& structure, const FrameState& sensor, const EdgePoint& edge,
                  double gate, EdgeLine* line);

}  // namespace volalign::refine_internal

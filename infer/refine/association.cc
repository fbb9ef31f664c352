#include "infer/refine/association.h"

#include <Eigen/Geometry>
#include <cmath>

#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

/// Least cosine between a silhouette and its edge (60 deg). Near a corner, the nearer of two edges
/// counts.
constexpr double kEdgeAgrees = 0.5;

}  // namespace

int NearestEdge(const Side& side, const Eigen::Vector3d& p, const Eigen::Vector3d& outward,
                double gate) {
  double best = gate;
  int nearest = -1;
  for (int i = 0; i < side.CountBorders(); ++i) {
    const Border border = side.BorderAt(i);
    if (border.outward.dot(outward) < kEdgeAgrees) continue;
    const Eigen::Vector3d from_middle = p - border.middle;
    const double distance = std::abs(border.outward.dot(from_middle));
    // Another border of an outline may lie on the same line.
    const double along = std::abs(border.outward.cross(side.normal).dot(from_middle));
    if (distance >= best || (side.outline && along > border.length / 2 + gate)) continue;
    best = distance;
    nearest = i;
  }
  return nearest;
}

bool LiesOnItsSide(const Structure& structure, const FrameState& sensor, const SidePoint& point,
                   double gate) {
  const Side& side = structure.SideOfLabel(point.label);
  const Eigen::Vector3d p = sensor.InStructure(point.p);
  if (!((side.ClosestPoint(p) - p).norm() <= gate)) return false;
  // A label beyond the side's edge would pull the side sideways. The point's own normal shows it.
  return point.normal.isZero() ||
         (sensor.structure_from_sensor.linear() * point.normal).dot(side.normal) > kFacesAlike;
}

int EdgeUnder(const Structure& structure, const FrameState& sensor, const EdgePoint& edge,
              double gate) {
  const Side& side = structure.SideOfLabel(edge.label);
  const Eigen::Matrix3d rotation = sensor.structure_from_sensor.linear();
  const Eigen::Vector3d p = sensor.InStructure(edge.p);
  if (!(std::abs(side.normal.dot(p - side.centre)) <= gate)) return -1;
  if ((rotation * edge.normal).dot(side.normal) < kFacesAlike) return -1;
  return NearestEdge(side, p, rotation * edge.outward, gate);
}

}  // namespace volalign::refine_internal

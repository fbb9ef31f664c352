#include "infer/refine/association.h"

#include <cmath>

#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

/// Least cosine between a silhouette and its edge (60 deg). Near a corner, the nearer of two edges
/// counts.
constexpr double kEdgeAgrees = 0.5;
/// The same for a one-sided silhouette, whose direction was measured. The border of a sensor's
/// light, or of a hiding object without depth, is seldom parallel to the side's edges.
constexpr double kOneSidedAgrees = kSameDirection;

}  // namespace

bool NearestEdge(const Side& side, const Eigen::Vector3d& p, const Eigen::Vector3d& outward,
                 double gate, EdgeLine* line) {
  double best = gate;
  bool found = false;
  for (int i = 0; i < 4; ++i) {
    const Eigen::Vector3d direction = (i % 2 ? -1.0 : 1.0) * (i < 2 ? side.axis_u : side.axis_v);
    if (direction.dot(outward) < kEdgeAgrees) continue;
    const double offset = direction.dot(side.centre) + (i < 2 ? side.half_u : side.half_v);
    const double distance = std::abs(direction.dot(p) - offset);
    if (distance < best) {
      best = distance;
      *line = {direction, offset, i};
      found = true;
    }
  }
  return found;
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

bool LiesOnAnEdge(const Structure& structure, const FrameState& sensor, const EdgePoint& edge,
                  double gate, EdgeLine* line) {
  const Side& side = structure.SideOfLabel(edge.label);
  const Eigen::Matrix3d rotation = sensor.structure_from_sensor.linear();
  const Eigen::Vector3d p = sensor.InStructure(edge.p);
  if (!(std::abs(side.normal.dot(p - side.centre)) <= gate)) return false;
  if ((rotation * edge.normal).dot(side.normal) < kFacesAlike) return false;
  const Eigen::Vector3d outward = rotation * edge.outward;
  return NearestEdge(side, p, outward, gate, line) &&
         (!edge.one_sided || line->direction.dot(outward) > kOneSidedAgrees);
}

}  // namespace volalign::refine_internal

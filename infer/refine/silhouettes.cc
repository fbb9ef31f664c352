#include "infer/refine/silhouettes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "infer/view/alike.h"

namespace volalign {

namespace {

constexpr int kMaxGap = 3;                  // px that a sensor may leave empty at an edge
constexpr int kMaxGrowth = 2 * kMaxGap;     // px that a label may fall short of its surface's end
constexpr double kOnPlane = kSamePlace;     // m, of a pixel that continues a side
constexpr double kBehind = 2 * kRoughPose;  // m, by which the depth has to jump at a silhouette
constexpr double kLeastIncidence = 0.2;     // cosine: beyond it half a pixel is centimetres of side
/// Pixels without depth at an edge belong to the background more often than to the side. On real
/// captures, edges halfway through the gap are a pixel too far out. So this share of it counts.
constexpr double kShareOfGap = 0.25;

/// A walk across the image, from a pixel of a side to where its surface ends.
struct Walk {
  int u, v;     // the last pixel on the surface, in the end
  int du, dv;   // the step
  int gap = 0;  // empty pixels beyond it
};

/// Plane normal . p = offset in the sensor frame.
struct Plane {
  Eigen::Vector3d normal;
  double offset;
  /// Depth at which a ray meets it.
  double Depth(const Eigen::Vector3d& ray) const { return offset / normal.dot(ray); }
};

/// Follows the plane to where a depth behind it follows. Returns false if no such end is nearby, or
/// if another labelled surface continues it.
bool WalkToEnd(const ConfidentSides& sides, const Plane& plane, Walk* walk) {
  const SensorView& view = sides.view;
  int steps = 0;
  for (; steps <= kMaxGrowth; ++steps) {
    const int x = walk->u + walk->du, y = walk->v + walk->dv;
    if (!view.depth.Contains(x, y)) return false;
    const double z = view.depth(x, y);
    if (!(z > 0) || std::abs(plane.normal.dot(view.Point(x, y)) - plane.offset) > kOnPlane) break;
    // On another side in the same plane, or back on the same side if the walk began too early.
    if (sides.segmentation.LabelAt(x, y) > 0) return false;
    walk->u = x;
    walk->v = y;
  }
  if (steps > kMaxGrowth) return false;
  for (walk->gap = 0; walk->gap <= kMaxGap; ++walk->gap) {
    const int x = walk->u + (walk->gap + 1) * walk->du, y = walk->v + (walk->gap + 1) * walk->dv;
    if (!view.depth.Contains(x, y)) return false;
    if (view.depth(x, y) > 0) return view.depth(x, y) > plane.Depth(view.Ray(x, y)) + kBehind;
  }
  return false;
}

/// The edge point at the end of a walk. The edge lies within the gap and one more pixel. False if
/// the plane is seen at too small an angle.
bool EdgeAt(const SensorView& view, const Walk& walk, const Plane& plane, EdgePoint* edge) {
  const int width = walk.gap + 1;
  const Eigen::Vector3d inner = view.Ray(walk.u, walk.v);
  const Eigen::Vector3d outer = view.Ray(walk.u + width * walk.du, walk.v + width * walk.dv);
  if (!(plane.normal.dot(outer) < -kLeastIncidence * outer.norm())) return false;
  const Eigen::Vector3d ray = inner + (outer - inner) * ((0.5 + walk.gap * kShareOfGap) / width);
  edge->p = ray * plane.Depth(ray);
  const Eigen::Vector3d across = outer * plane.Depth(outer) - inner * plane.Depth(inner);
  edge->outward = across.normalized();
  edge->normal = plane.normal;
  edge->sigma = across.norm() * StepSigma();
  edge->pixel = across.norm() / width;
  edge->axis = walk.dv != 0;
  edge->block = BlockIndex(walk.u, walk.v, view.width());
  return true;
}

}  // namespace

std::vector<EdgePoint> FindSilhouettes(const ConfidentSides& sides) {
  const SensorView& view = sides.view;
  const LabelImage& labels = sides.segmentation.labels;
  std::vector<EdgePoint> found;
  view.VisitMeasured(1, [&](int u, int v) {
    const int label = sides.At(u, v);
    if (label == 0) return;
    for (const auto& [du, dv] : kBeside) {
      const int x = u + du, y = v + dv;
      if (!view.depth.Contains(x, y) || labels(x, y) == label) continue;
      // The normal is taken inside the side, where its neighbourhood is whole.
      const int in_u = u - kNormalRadius * du, in_v = v - kNormalRadius * dv;
      Plane plane;
      if (!view.depth.Contains(in_u, in_v) || labels(in_u, in_v) != label ||
          !PixelNormal(view, in_u, in_v, &plane.normal)) {
        continue;
      }
      plane.offset = plane.normal.dot(view.Point(in_u, in_v));
      Walk walk{u, v, du, dv};
      EdgePoint edge;
      edge.label = label;
      if (WalkToEnd(sides, plane, &walk) && EdgeAt(view, walk, plane, &edge)) found.push_back(edge);
    }
  });
  return found;
}

}  // namespace volalign

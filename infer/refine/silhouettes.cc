#include "infer/refine/silhouettes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

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
// One-sided silhouettes.
/// If there are so many two-sided points along one image axis, one-sided ones are not used. They
/// depend on the sensor's losses along edges and would only blur the structure's end.
constexpr int kEnough = 40;
constexpr int kNeighbours = 8;  // rows (or columns) on each side that have to form a line
constexpr std::size_t kFewestEnds =
    kNeighbours + 1;              // of these and its own, in which the side ends nearby
constexpr int kEndTolerance = 4;  // px between the ends of neighbours, beyond a slope of 1
constexpr double kRagged = 1.5;   // px rms, of the ends about their line

/// A walk across the image, from a pixel of a side to where its surface ends.
struct Walk {
  int u, v;                // the last pixel on the surface, in the end
  int du, dv;              // the step
  int gap;                 // empty pixels beyond it
  int beyond_u, beyond_v;  // the first pixel with depth after them; may be outside of the picture
};

/// Plane normal . p = offset in the sensor frame.
struct Plane {
  Eigen::Vector3d normal;
  double offset;
  /// Depth at which a ray meets it.
  double Depth(const Eigen::Vector3d& ray) const { return offset / normal.dot(ray); }
};

Eigen::Vector3d RayAt(const SensorView& view, int u, int v) {
  return view.rays.at(u, v).cast<double>().homogeneous();
}

/// Follows the plane. Returns false if no end of it is nearby, or if another labelled surface
/// continues it.
bool WalkToEnd(const ConfidentSides& sides, const Plane& plane, Walk* walk) {
  const SensorView& view = sides.view;
  int steps = 0;
  for (; steps <= kMaxGrowth; ++steps) {
    const int x = walk->u + walk->du, y = walk->v + walk->dv;
    if (!view.depth.Contains(x, y)) return false;
    const double z = view.depth(x, y);
    if (!(z > 0) || std::abs(plane.normal.dot(view.Point(x, y)) - plane.offset) > kOnPlane) break;
    const int other = sides.segmentation.labels(x, y);
    // On another side in the same plane, or back on the same side if the walk began too early.
    if (other > 0 && sides.segmentation.confidence(x, y) >= sides.min_confidence) return false;
    walk->u = x;
    walk->v = y;
  }
  if (steps > kMaxGrowth) return false;
  walk->gap = 0;
  walk->beyond_u = walk->u + walk->du;
  walk->beyond_v = walk->v + walk->dv;
  while (view.depth.Contains(walk->beyond_u, walk->beyond_v) &&
         !(view.depth(walk->beyond_u, walk->beyond_v) > 0)) {
    ++walk->gap;
    walk->beyond_u += walk->du;
    walk->beyond_v += walk->dv;
  }
  return true;
}

/// Does the view end behind the walk on something farther away than the plane, or on nothing?
bool SeesPast(const SensorView& view, const Walk& walk, const Plane& plane) {
  if (!view.depth.Contains(walk.beyond_u, walk.beyond_v)) return walk.gap > kEmptyBorder;
  const Eigen::Vector3d ray = RayAt(view, walk.beyond_u, walk.beyond_v);
  return view.depth(walk.beyond_u, walk.beyond_v) > plane.Depth(ray) + kBehind;
}

/// The edge point at the end of a walk, `pixels` beyond the middle of the last pixel. The edge lies
/// within the next `width` pixels. False if the plane is seen at too small an angle.
bool EdgeAt(const SensorView& view, const Walk& walk, const Plane& plane, double pixels, int width,
            EdgePoint* edge) {
  const Eigen::Vector3d inner = RayAt(view, walk.u, walk.v);
  const Eigen::Vector3d outer = RayAt(view, walk.u + width * walk.du, walk.v + width * walk.dv);
  if (!(plane.normal.dot(outer) < -kLeastIncidence * outer.norm())) return false;
  const Eigen::Vector3d ray = inner + (outer - inner) * (pixels / width);
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

/// A one-sided edge point, and where in the picture the side ends.
struct Candidate {
  EdgePoint edge;
  Walk walk;
  /// Row (or column) that was walked along, and the place in it.
  int line() const { return edge.axis == 0 ? walk.v : walk.u; }
  int end() const { return edge.axis == 0 ? walk.u : walk.v; }
  int sign() const { return walk.du + walk.dv; }
};

/// Ends of sides, by label, axis and direction of the walk, and line.
using Ends = std::map<std::array<int, 4>, std::vector<int>>;

std::array<int, 4> KeyOf(const Candidate& c, int line) {
  return {c.edge.label, c.edge.axis, c.sign(), line};
}

/// Slope, px per line, of the line that the ends near a candidate form. False if they form none.
bool FitSlope(const Candidate& candidate, const Ends& ends, double* slope) {
  std::vector<std::pair<double, double>> found;  // line and end, from the candidate's own
  for (int d = -kNeighbours; d <= kNeighbours; ++d) {
    const auto row = ends.find(KeyOf(candidate, candidate.line() + d));
    if (row == ends.end()) continue;
    int nearest = std::abs(d) + kEndTolerance + 1;
    for (const int end : row->second) {
      const int apart = end - candidate.end();
      if (std::abs(apart) < std::abs(nearest)) nearest = apart;
    }
    if (std::abs(nearest) <= std::abs(d) + kEndTolerance) found.emplace_back(d, nearest);
  }
  if (found.size() < kFewestEnds) return false;
  Eigen::Matrix2d squares = Eigen::Matrix2d::Zero();
  Eigen::Vector2d moment = Eigen::Vector2d::Zero();
  for (const auto& [line, end] : found) {
    const Eigen::Vector2d row(1, line);
    squares += row * row.transpose();
    moment += row * end;
  }
  const Eigen::Vector2d fit = squares.inverse() * moment;
  double misfit = 0;
  for (const auto& [line, end] : found)
    misfit += std::pow(end - fit[0] - fit[1] * line, 2) / static_cast<double>(found.size());
  *slope = fit[1];
  return misfit <= kRagged * kRagged;
}

/// Turns `outward` perpendicular to the silhouette, which has that slope in the picture.
void TurnSquare(const SensorView& view, const Candidate& candidate, double slope, EdgePoint* edge) {
  const int u = std::clamp(candidate.walk.u, 1, view.width() - 2);
  const int v = std::clamp(candidate.walk.v, 1, view.height() - 2);
  const Eigen::Vector3d per_u = (RayAt(view, u + 1, v) - RayAt(view, u - 1, v)) / 2;
  const Eigen::Vector3d per_v = (RayAt(view, u, v + 1) - RayAt(view, u, v - 1)) / 2;
  const Eigen::Vector3d ray = edge->p / edge->p.z();
  const Eigen::Vector3d turn = edge->axis == 0 ? per_v + slope * per_u : per_u + slope * per_v;
  // Derivative of the intersection of ray and plane.
  const Eigen::Vector3d along = turn - ray * (edge->normal.dot(turn) / edge->normal.dot(ray));
  const Eigen::Vector3d square = along.cross(edge->normal).normalized();
  edge->outward = square.dot(edge->outward) < 0 ? Eigen::Vector3d(-square) : square;
}

/// The candidates at which sides end along a line, for image axes with too few two-sided points.
std::vector<EdgePoint> Straight(const SensorView& view, const std::vector<Candidate>& candidates,
                                const std::vector<EdgePoint>& two_sided) {
  Ends ends;
  for (const Candidate& c : candidates) ends[KeyOf(c, c.line())].push_back(c.end());
  std::map<int, int> known;  // two-sided points by axis
  for (const EdgePoint& edge : two_sided) ++known[edge.axis];
  std::vector<EdgePoint> edges;
  for (const Candidate& candidate : candidates) {
    double slope = 0;
    if (known[candidate.edge.axis] >= kEnough || !FitSlope(candidate, ends, &slope)) continue;
    edges.push_back(candidate.edge);
    edges.back().one_sided = true;
    TurnSquare(view, candidate, slope, &edges.back());
  }
  return edges;
}

}  // namespace

Silhouettes FindSilhouettes(const ConfidentSides& sides) {
  const SensorView& view = sides.view;
  const LabelImage& labels = sides.segmentation.labels;
  Silhouettes found;
  std::vector<Candidate> candidates;
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
          !PixelNormal(view, in_u, in_v, kNormalRadius, &plane.normal)) {
        continue;
      }
      plane.offset = plane.normal.dot(view.Point(in_u, in_v));
      Candidate candidate;
      candidate.walk = {u, v, du, dv, 0, u, v};
      candidate.edge.label = label;
      const Walk& walk = candidate.walk;
      if (!WalkToEnd(sides, plane, &candidate.walk) || !SeesPast(view, walk, plane)) continue;
      const int gap = std::min(walk.gap, kMaxGap);
      if (!EdgeAt(view, walk, plane, 0.5 + gap * kShareOfGap, gap + 1, &candidate.edge)) continue;
      if (walk.gap <= kMaxGap) {
        found.two_sided.push_back(candidate.edge);
      } else {
        candidates.push_back(std::move(candidate));
      }
    }
  });
  found.one_sided = Straight(view, candidates, found.two_sided);
  return found;
}

}  // namespace volalign

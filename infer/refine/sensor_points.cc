#include "infer/refine/sensor_points.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "core/random.h"

namespace volalign {

namespace {

constexpr int kNormalRadius = 3;         // px, of the neighbourhood that a normal is taken from
constexpr double kMostBent = 0.08;       // smallest by middle variance of a flat neighbourhood
constexpr int kMaxGrowth = 6;            // px that a label may fall short of its surface's end
constexpr int kMaxGap = 3;               // px that a sensor may leave empty at an edge
constexpr double kOnPlane = 0.02;        // m, of a pixel that continues a side
constexpr double kBehind = 0.06;         // m, by which the depth has to jump at a silhouette
constexpr double kLeastIncidence = 0.2;  // cosine: beyond it half a pixel is centimetres of side
/// The pixels that are lost at an edge belong to the background more often than to the side: on
/// real captures, edges halfway through the gap come out a pixel too far out. So only this share
/// counts.
constexpr double kShareOfGap = 0.25;

/// Keeps at most `most` elements, evenly spread.
template <class T>
void Thin(std::vector<T>* items, std::size_t most) {
  if (items->size() <= most) return;
  std::vector<T> kept;
  kept.reserve(most);
  for (std::size_t i = 0; i < most; ++i) kept.push_back((*items)[i * items->size() / most]);
  *items = std::move(kept);
}

/// A labelled view, as the steps below ask it.
struct LabelledView {
  const SensorView& view;
  const SegmentationResult& segmentation;
  std::size_t classes;
  double min_confidence;

  /// The side that a pixel is confidently on and has depth for, or 0.
  int SideAt(int u, int v) const {
    const int label = segmentation.labels(u, v);
    const bool usable = label > 0 && static_cast<std::size_t>(label) < classes &&
                        view.depth(u, v) > 0 && segmentation.confidence(u, v) >= min_confidence;
    return usable ? label : 0;
  }
};

std::vector<std::vector<int>> PixelsByLabel(const LabelledView& labelled) {
  std::vector<std::vector<int>> by_label(labelled.classes);
  for (int v = 0; v < labelled.view.height(); ++v) {
    for (int u = 0; u < labelled.view.width(); ++u) {
      const int label = labelled.SideAt(u, v);
      if (label > 0)
        by_label[static_cast<std::size_t>(label)].push_back(v * labelled.view.width() + u);
    }
  }
  return by_label;
}

/// At most `max_points` points of each use (a decision by a fifth as many would be noisy), the same
/// number of each side.
std::vector<SidePoint> SampleSidePoints(const LabelledView& labelled, int max_points) {
  const SensorView& view = labelled.view;
  std::vector<std::vector<int>> by_label = PixelsByLabel(labelled);
  std::size_t sides = 0;
  for (const auto& pixels : by_label) sides += pixels.empty() ? 0 : 1;
  const std::size_t share = static_cast<std::size_t>(max_points) / std::max<std::size_t>(1, sides);
  std::vector<SidePoint> points;
  for (std::size_t label = 1; label < labelled.classes; ++label) {
    std::vector<int>& pixels = by_label[label];
    // A stride that has a common divisor with the image's width would sample few columns.
    RandomStream random(0, label, "refine_view");
    for (std::size_t i = pixels.size(); i > 1; --i) {
      std::swap(pixels[i - 1], pixels[static_cast<std::size_t>(random.Below(static_cast<int>(i)))]);
    }
    std::map<BlockUse, std::size_t> taken;
    for (const int i : pixels) {
      const int u = i % view.width(), v = i / view.width();
      const BlockUse use = UseOfBlock(u, v);
      if (++taken[use] > share) continue;
      SidePoint point;
      point.p = view.Point(u, v);
      point.label = static_cast<int>(label);
      point.block = BlockIndex(u, v, view.width());
      point.use = use;
      if (!PixelNormal(view, u, v, kNormalRadius, &point.normal)) point.normal.setZero();
      points.push_back(point);
    }
  }
  return points;
}

/// A walk across the image, from a pixel of a side to where its surface ends.
struct Walk {
  int u, v;    // the last pixel on the surface, in the end
  int du, dv;  // the step
  int gap;     // empty pixels beyond it
  int beyond_u, beyond_v;
};

/// Follows the plane normal . p = offset. Returns false where no end of it is seen nearby, or where
/// another labelled surface continues it.
bool WalkToEnd(const LabelledView& labelled, const Eigen::Vector3d& normal, double offset,
               Walk* walk) {
  const SensorView& view = labelled.view;
  int steps = 0;
  for (; steps <= kMaxGrowth; ++steps) {
    const int x = walk->u + walk->du, y = walk->v + walk->dv;
    if (!view.depth.Contains(x, y)) return false;
    const double z = view.depth(x, y);
    if (!(z > 0) || std::abs(normal.dot(view.Point(x, y)) - offset) > kOnPlane) break;
    const int other = labelled.segmentation.labels(x, y);
    // On another side in the same plane, or back on the same side, where the walk began too
    // early.
    if (other > 0 && labelled.segmentation.confidence(x, y) >= labelled.min_confidence)
      return false;
    walk->u = x;
    walk->v = y;
  }
  if (steps > kMaxGrowth) return false;
  int x = walk->u + walk->du, y = walk->v + walk->dv;
  walk->gap = 0;
  while (view.depth.Contains(x, y) && !(view.depth(x, y) > 0)) {
    if (++walk->gap > kMaxGap) return false;
    x += walk->du;
    y += walk->dv;
  }
  walk->beyond_u = x;
  walk->beyond_v = y;
  return view.depth.Contains(x, y);
}

/// The edge point at the end of a walk, if what lies beyond is farther away.
bool SilhouetteAt(const SensorView& view, const Walk& walk, const Eigen::Vector3d& normal,
                  double offset, EdgePoint* edge) {
  const Eigen::Vector2d first = view.rays.at(walk.u, walk.v).cast<double>();
  const Eigen::Vector2d last = view.rays.at(walk.beyond_u, walk.beyond_v).cast<double>();
  const Eigen::Vector3d beyond(last.x(), last.y(), 1);
  const double facing = normal.dot(beyond);
  if (!(facing < -kLeastIncidence * beyond.norm())) return false;
  // Depth at which the ray behind the edge would meet the side's plane.
  if (!(view.depth(walk.beyond_u, walk.beyond_v) > offset / facing + kBehind)) return false;

  const int gap = walk.gap;
  const Eigen::Vector2d middle = first + (last - first) * ((0.5 + gap * kShareOfGap) / (gap + 1));
  const Eigen::Vector3d ray(middle.x(), middle.y(), 1);
  const Eigen::Vector3d inner(first.x(), first.y(), 1);
  edge->p = ray * (offset / normal.dot(ray));
  const Eigen::Vector3d across = beyond * (offset / facing) - inner * (offset / normal.dot(inner));
  edge->outward = across.normalized();
  edge->normal = normal;
  edge->sigma = across.norm() / std::sqrt(12.0);
  edge->pixel = across.norm() / (gap + 1);
  edge->axis = walk.dv != 0;
  edge->block = BlockIndex(walk.u, walk.v, view.width());
  edge->use = UseOfBlock(walk.u, walk.v);
  return true;
}

/// From every pixel of a side whose neighbour is none of it, across that border.
std::vector<EdgePoint> FindSilhouettes(const LabelledView& labelled) {
  constexpr std::array<std::pair<int, int>, 4> kSteps = {{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};
  const SensorView& view = labelled.view;
  const LabelImage& labels = labelled.segmentation.labels;
  std::vector<EdgePoint> edges;
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const int label = labelled.SideAt(u, v);
      if (label == 0) continue;
      for (const auto& [du, dv] : kSteps) {
        const int x = u + du, y = v + dv;
        if (!view.depth.Contains(x, y) || labels(x, y) == label) continue;
        // The normal is taken inside the side, where its neighbourhood is whole.
        const int in_u = u - kNormalRadius * du, in_v = v - kNormalRadius * dv;
        Eigen::Vector3d normal;
        if (!view.depth.Contains(in_u, in_v) || labels(in_u, in_v) != label ||
            !PixelNormal(view, in_u, in_v, kNormalRadius, &normal)) {
          continue;
        }
        const double offset = normal.dot(view.Point(in_u, in_v));
        Walk walk{u, v, du, dv, 0, u, v};
        EdgePoint edge;
        edge.label = label;
        if (WalkToEnd(labelled, normal, offset, &walk) &&
            SilhouetteAt(view, walk, normal, offset, &edge)) {
          edges.push_back(edge);
        }
      }
    }
  }
  return edges;
}

std::vector<CloudPoint> SampleCloud(const SensorView& view, int stride, double max_range) {
  std::vector<CloudPoint> cloud;
  for (int v = stride / 2; v < view.height(); v += stride) {
    for (int u = stride / 2; u < view.width(); u += stride) {
      CloudPoint point;
      if (view.depth(u, v) > max_range || !PixelNormal(view, u, v, kNormalRadius, &point.normal))
        continue;
      point.p = view.Point(u, v);
      point.use = UseOfBlock(u, v);
      cloud.push_back(point);
    }
  }
  return cloud;
}

}  // namespace

int BlockIndex(int u, int v, int width) {
  return v / kHeldOutBlock * (width / kHeldOutBlock + 1) + u / kHeldOutBlock;
}

bool PixelNormal(const SensorView& view, int u, int v, int radius, Eigen::Vector3d* normal) {
  const double z = view.depth(u, v);
  if (!(z > 0)) return false;
  const Eigen::Vector3d centre = view.Point(u, v);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  int count = 0;
  for (int y = std::max(0, v - radius); y <= std::min(view.height() - 1, v + radius); ++y) {
    for (int x = std::max(0, u - radius); x <= std::min(view.width() - 1, u + radius); ++x) {
      const double other = view.depth(x, y);
      if (!(other > 0) || std::abs(other - z) > radius * DepthJump(z)) continue;
      const Eigen::Vector3d d = view.Point(x, y) - centre;
      sum += d;
      squares += d * d.transpose();
      ++count;
    }
  }
  if (2 * count < (2 * radius + 1) * (2 * radius + 1)) return false;
  sum /= count;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(squares / count - sum * sum.transpose());
  if (!(solver.eigenvalues()[0] <= kMostBent * solver.eigenvalues()[1])) return false;
  *normal = solver.eigenvectors().col(0);
  if (normal->dot(centre) > 0) *normal = -*normal;
  return normal->allFinite();
}

SensorPoints::SensorPoints(std::vector<SidePoint> sides, std::vector<EdgePoint> edges,
                           std::vector<CloudPoint> cloud)
    : side_points(std::move(sides)), edge_points(std::move(edges)), cloud_(std::move(cloud)) {
  std::vector<Eigen::Vector3d> positions;
  positions.reserve(cloud_.size());
  for (const CloudPoint& point : cloud_) positions.push_back(point.p);
  if (!positions.empty()) tree_.emplace(std::move(positions));
}

int SensorPoints::Nearest(const Eigen::Vector3d& p, double max_distance) const {
  if (!tree_) return -1;
  const KdTree::Neighbour nearest = tree_->Nearest(p);
  return nearest.squared_distance <= max_distance * max_distance ? nearest.index : -1;
}

SensorPoints SamplePoints(const SensorView& view, const SegmentationResult& segmentation,
                          const Structure& structure, const SamplingOptions& options) {
  const LabelledView labelled{view, segmentation, static_cast<std::size_t>(structure.num_classes()),
                              options.min_confidence};
  std::vector<EdgePoint> edges = FindSilhouettes(labelled);
  Thin(&edges, static_cast<std::size_t>(options.max_edge_points));
  return {SampleSidePoints(labelled, options.max_side_points), std::move(edges),
          SampleCloud(view, options.cloud_stride, options.max_range)};
}

}  // namespace volalign

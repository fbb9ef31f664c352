#include "infer/refine/refine_view.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <nanoflann.hpp>
#include <utility>

#include "core/random.h"
#include "infer/view/held_out.h"

namespace volalign {

namespace {

constexpr int kNormalRadius = 3;

static_assert(RefineView::kBlock == kHeldOutBlock);

/// Keeps at most `most` elements, evenly spread.
template <class T>
void Thin(std::vector<T>* items, std::size_t most) {
  if (items->size() <= most) return;
  std::vector<T> kept;
  kept.reserve(most);
  for (std::size_t i = 0; i < most; ++i) kept.push_back((*items)[i * items->size() / most]);
  *items = std::move(kept);
}

/// Walks from a pixel of a side across the image until the surface ends.
struct Silhouette {
  const SensorView& view;
  const SegmentationResult& segmentation;
  double min_confidence;

  /// Pixels that a label may fall short of its surface, and that a sensor may leave empty at an
  /// edge.
  static constexpr int kMaxGrowth = 6, kMaxGap = 3;

  /// From (u, v) in steps of (du, dv): is there a surface's end with something at least kBehind
  /// farther beyond, and where?
  bool Find(int u, int v, int du, int dv, int label, const Eigen::Vector3d& normal, double offset,
            EdgePoint* edge) const {
    constexpr double kOnPlane = 0.02, kBehind = 0.06;
    int steps = 0;
    for (; steps <= kMaxGrowth; ++steps) {
      const int x = u + du, y = v + dv;
      if (!view.depth.Contains(x, y)) return false;
      const double z = view.depth(x, y);
      if (!(z > 0) || std::abs(normal.dot(view.Point(x, y)) - offset) > kOnPlane) break;
      const int other = segmentation.labels(x, y);
      // On another side in the same plane, or back on the same side, where the walk began too
      // early.
      if (other > 0 && segmentation.confidence(x, y) >= min_confidence) return false;
      u = x;
      v = y;
    }
    if (steps > kMaxGrowth) return false;
    int gap = 0;
    int x = u + du, y = v + dv;
    while (view.depth.Contains(x, y) && !(view.depth(x, y) > 0)) {
      if (++gap > kMaxGap) return false;
      x += du;
      y += dv;
    }
    if (!view.depth.Contains(x, y)) return false;
    const Eigen::Vector2d first = view.rays.at(u, v).cast<double>();
    const Eigen::Vector2d last = view.rays.at(x, y).cast<double>();
    const Eigen::Vector3d beyond(last.x(), last.y(), 1);
    const double facing = normal.dot(beyond);
    // At grazing incidence half a pixel is centimetres of the side.
    if (!(facing < -0.2 * beyond.norm())) return false;
    // Depth at which the ray behind the edge would meet the side's plane.
    if (!(view.depth(x, y) > offset / facing + kBehind)) return false;

    // The pixels that are lost at an edge belong to the background more often than to the side: on
    // the real captures, edges halfway through the gap come out a pixel too far out. So only a
    // quarter of the gap counts.
    const Eigen::Vector2d middle = first + (last - first) * ((0.5 + gap / 4.0) / (gap + 1));
    const Eigen::Vector3d ray(middle.x(), middle.y(), 1);
    const Eigen::Vector3d inner(first.x(), first.y(), 1);
    edge->p = ray * (offset / normal.dot(ray));
    const Eigen::Vector3d across =
        beyond * (offset / facing) - inner * (offset / normal.dot(inner));
    edge->outward = across.normalized();
    edge->normal = normal;
    edge->sigma = across.norm() / std::sqrt(12.0);
    edge->pixel = across.norm() / (gap + 1);
    edge->label = label;
    edge->axis = dv != 0;
    edge->block = RefineView::BlockOf(u, v, view.width());
    edge->held_out = HeldOut(u, v);
    return true;
  }
};

}  // namespace

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
  if (!(solver.eigenvalues()[0] <= 0.08 * solver.eigenvalues()[1])) return false;
  *normal = solver.eigenvectors().col(0);
  if (normal->dot(centre) > 0) *normal = -*normal;
  return normal->allFinite();
}

struct RefineView::Tree {
  const std::vector<CloudPoint>* points;
  std::size_t kdtree_get_point_count() const { return points->size(); }
  double kdtree_get_pt(std::size_t i, std::size_t d) const {
    return (*points)[i].p[static_cast<Eigen::Index>(d)];
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
  using Index =
      nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Tree>, Tree, 3>;
  std::unique_ptr<Index> index;
};

RefineView::RefineView(const SensorView& view, const SegmentationResult& segmentation,
                       const Structure& structure, const Options& options) {
  const auto classes = static_cast<std::size_t>(structure.num_classes());
  std::vector<std::vector<int>> by_label(classes);
  for (std::size_t i = 0; i < view.depth.size(); ++i) {
    const std::size_t label = segmentation.labels[i];
    if (label > 0 && label < classes && view.depth[i] > 0 &&
        segmentation.confidence[i] >= options.min_confidence) {
      by_label[label].push_back(static_cast<int>(i));
    }
  }
  std::size_t sides = 0;
  for (const auto& pixels : by_label) sides += pixels.empty() ? 0 : 1;
  const std::size_t share =
      static_cast<std::size_t>(options.max_side_points) / std::max<std::size_t>(1, sides);
  for (std::size_t label = 1; label < classes; ++label) {
    std::vector<int>& pixels = by_label[label];
    // A stride that has a common divisor with the image's width would sample few columns.
    RandomStream random(0, label, "refine_view");
    for (std::size_t i = pixels.size(); i > 1; --i) {
      std::swap(pixels[i - 1], pixels[static_cast<std::size_t>(random.Below(static_cast<int>(i)))]);
    }
    // As many held-out points again: a decision by a fifth of the others would be noisy.
    std::size_t used = 0, held_out = 0;
    for (const int i : pixels) {
      const int u = i % view.width(), v = i / view.width();
      const bool out = HeldOut(u, v);
      if (++(out ? held_out : used) > share) continue;
      SidePoint point;
      point.p = view.Point(u, v);
      point.label = static_cast<int>(label);
      point.block = BlockOf(u, v, view.width());
      point.held_out = out;
      if (!PixelNormal(view, u, v, kNormalRadius, &point.normal)) point.normal.setZero();
      side_points.push_back(point);
    }
  }

  const Silhouette silhouette{view, segmentation, options.min_confidence};
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const int label = segmentation.labels(u, v);
      if (label == 0 || static_cast<std::size_t>(label) >= classes || !(view.depth(u, v) > 0) ||
          segmentation.confidence(u, v) < options.min_confidence) {
        continue;
      }
      for (const auto& [du, dv] :
           std::array<std::pair<int, int>, 4>{{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}}) {
        const int x = u + du, y = v + dv;
        if (!view.depth.Contains(x, y) || segmentation.labels(x, y) == label) continue;
        // The normal is taken inside the side, where its neighbourhood is whole.
        const int in_u = u - kNormalRadius * du, in_v = v - kNormalRadius * dv;
        Eigen::Vector3d normal;
        if (!view.depth.Contains(in_u, in_v) || segmentation.labels(in_u, in_v) != label ||
            !PixelNormal(view, in_u, in_v, kNormalRadius, &normal)) {
          continue;
        }
        EdgePoint edge;
        if (silhouette.Find(u, v, du, dv, label, normal, normal.dot(view.Point(in_u, in_v)),
                            &edge)) {
          edge_points.push_back(edge);
        }
      }
    }
  }
  Thin(&edge_points, static_cast<std::size_t>(options.max_edge_points));

  const int stride = options.cloud_stride;
  for (int v = stride / 2; v < view.height(); v += stride) {
    for (int u = stride / 2; u < view.width(); u += stride) {
      CloudPoint point;
      if (view.depth(u, v) > options.max_range ||
          !PixelNormal(view, u, v, kNormalRadius, &point.normal)) {
        continue;
      }
      point.p = view.Point(u, v);
      point.held_out = HeldOut(u, v);
      cloud.push_back(point);
    }
  }
  tree_ = std::make_unique<Tree>();
  tree_->points = &cloud;
  tree_->index =
      std::make_unique<Tree::Index>(3, *tree_, nanoflann::KDTreeSingleIndexAdaptorParams(10));
  tree_->index->buildIndex();
}

RefineView::~RefineView() = default;

RefineView::RefineView(RefineView&& other) noexcept
    : side_points(std::move(other.side_points)),
      edge_points(std::move(other.edge_points)),
      cloud(std::move(other.cloud)),
      tree_(std::move(other.tree_)) {
  if (tree_) tree_->points = &cloud;
}

RefineView& RefineView::operator=(RefineView&& other) noexcept {
  side_points = std::move(other.side_points);
  edge_points = std::move(other.edge_points);
  cloud = std::move(other.cloud);
  tree_ = std::move(other.tree_);
  if (tree_) tree_->points = &cloud;
  return *this;
}

int RefineView::Nearest(const Eigen::Vector3d& p, double max_distance) const {
  if (cloud.empty()) return -1;
  std::uint32_t index = 0;
  double squared = 0;
  const std::size_t found = tree_->index->knnSearch(p.data(), 1, &index, &squared);
  return found == 1 && squared <= max_distance * max_distance ? static_cast<int>(index) : -1;
}

}  // namespace volalign

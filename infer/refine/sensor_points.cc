#include "infer/refine/sensor_points.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include "core/base/lists.h"
#include "core/base/random.h"
#include "infer/refine/silhouettes.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

constexpr double kMostBent = 0.08;  // smallest by middle variance of a flat neighbourhood

template <class Key>
void SortByKey(std::vector<int>* items, const Key& key) {
  std::vector<std::pair<std::uint32_t, int>> keyed;
  keyed.reserve(items->size());
  for (const int item : *items) keyed.emplace_back(key(item), item);
  std::sort(keyed.begin(), keyed.end());
  for (std::size_t i = 0; i < keyed.size(); ++i) (*items)[i] = keyed[i].second;
}

std::vector<std::vector<int>> PixelsByLabel(const ConfidentSides& sides) {
  std::vector<std::vector<int>> by_label(sides.classes);
  sides.view.VisitMeasured(1, [&](int u, int v) {
    const int label = sides.At(u, v);
    if (label > 0) by_label[static_cast<std::size_t>(label)].push_back(v * sides.view.width() + u);
  });
  return by_label;
}

/// Does all of the window of a pixel's depth lie on the pixel's own side? A matcher enlarges nearer
/// surfaces by up to half its window, and rounds off corners.
bool HasItsOwnDepth(const ConfidentSides& sides, int u, int v) {
  const SensorView& view = sides.view;
  if (view.errors.window_rad == 0) return true;
  const double half_window = view.errors.window_rad / std::sqrt(view.ray_areas(u, v)) / 2;
  const int reach = static_cast<int>(std::ceil(half_window + 0.5));
  const double here = view.depth(u, v);
  for (const auto& [du, dv] : kBeside) {
    for (int step = 1; step <= reach; ++step) {
      // Across pixels without depth.
      int x = u + step * du, y = v + step * dv;
      for (; view.depth.Contains(x, y) && !(view.depth(x, y) > 0); y += dv) x += du;
      if (!view.depth.Contains(x, y)) return false;
      if (sides.At(x, y) == sides.At(u, v)) continue;
      if (step < reach || view.depth(x, y) - here > DepthJump(here)) return false;
    }
  }
  return true;
}

/// At most `max_points` points, the same number on each side.
std::vector<SidePoint> SampleSidePoints(const ConfidentSides& sides, int max_points) {
  const SensorView& view = sides.view;
  std::vector<std::vector<int>> by_label = PixelsByLabel(sides);
  std::size_t seen = 0;
  for (const auto& pixels : by_label) seen += pixels.empty() ? 0 : 1;
  const std::size_t share = static_cast<std::size_t>(max_points) / std::max<std::size_t>(1, seen);
  std::vector<SidePoint> points;
  for (std::size_t label = 1; label < sides.classes; ++label) {
    std::vector<int>& pixels = by_label[label];
    // Each pixel has its own place in the order. So labels that differ in a few pixels give points
    // that differ in a few. (A stride that has a common divisor with the image's width would sample
    // few columns.)
    SortByKey(&pixels, [](int pixel) {
      return Philox4x32({static_cast<std::uint32_t>(pixel), 0, 0, 0}, {0, 0})[0];
    });
    pixels.resize(std::min(pixels.size(), share));
    for (const int i : pixels) {
      const int u = i % view.width(), v = i / view.width();
      SidePoint point;
      point.p = view.Point(u, v);
      point.label = static_cast<int>(label);
      if (!view.depth_sigma.empty()) point.sigma = view.depth_sigma(u, v);
      point.block = BlockIndex(u, v, view.width());
      if (!HasItsOwnDepth(sides, u, v))
        point.lateral_sigma_rad = view.errors.window_rad / 2 / std::sqrt(3);
      if (!PixelNormal(view, u, v, &point.normal)) point.normal.setZero();
      points.push_back(point);
    }
  }
  return points;
}

}  // namespace

int BlockIndex(int u, int v, int width) { return v / kBlock * (width / kBlock + 1) + u / kBlock; }

bool PixelNormal(const SensorView& view, int u, int v, Eigen::Vector3d* normal) {
  constexpr int radius = kNormalRadius;
  const double z = view.depth(u, v);
  if (!(z > 0)) return false;
  const Eigen::Vector3d centre = view.Point(u, v);
  const double most_apart = radius * DepthJump(z);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
  int count = 0;
  for (int y = std::max(0, v - radius); y <= std::min(view.height() - 1, v + radius); ++y) {
    for (int x = std::max(0, u - radius); x <= std::min(view.width() - 1, u + radius); ++x) {
      const double other = view.depth(x, y);
      if (!(other > 0) || std::abs(other - z) > most_apart) continue;
      const Eigen::Vector3d d = view.Point(x, y) - centre;
      sum += d;
      xx += d.x() * d.x();
      xy += d.x() * d.y();
      xz += d.x() * d.z();
      yy += d.y() * d.y();
      yz += d.y() * d.z();
      zz += d.z() * d.z();
      ++count;
    }
  }
  if (2 * count < (2 * radius + 1) * (2 * radius + 1)) return false;
  sum /= count;
  Eigen::Matrix3d squares;
  squares << xx, xy, xz, xy, yy, yz, xz, yz, zz;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(squares / count - sum * sum.transpose());
  if (!(solver.eigenvalues()[0] <= kMostBent * solver.eigenvalues()[1])) return false;
  *normal = solver.eigenvectors().col(0);
  if (normal->dot(centre) > 0) *normal = -*normal;
  return normal->allFinite();
}

SampledCloud::SampledCloud(std::vector<CloudPoint> points) {
  if (points.empty()) return;
  std::vector<Eigen::Vector3d> positions;
  positions.reserve(points.size());
  for (const CloudPoint& point : points) positions.push_back(point.p);
  points_ = std::make_shared<const Points>(Points{std::move(points), KdTree(std::move(positions))});
}

const std::vector<CloudPoint>& SampledCloud::points() const {
  static const std::vector<CloudPoint> none;
  return points_ ? points_->all : none;
}

int SampledCloud::Nearest(const Eigen::Vector3d& p, double max_distance) const {
  return points_ ? points_->tree.Nearest(p, max_distance).index : -1;
}

SampledCloud SampleCloud(const SensorView& view) {
  std::vector<CloudPoint> cloud;
  view.VisitMeasured(2, [&](int u, int v) {
    CloudPoint point;
    if (view.depth(u, v) > kFarthest || !PixelNormal(view, u, v, &point.normal)) return;
    point.p = view.Point(u, v);
    cloud.push_back(point);
  });
  return SampledCloud(std::move(cloud));
}

SensorPoints SamplePoints(const SensorView& view, const SegmentationResult& segmentation,
                          const Structure& structure, const RefineOptions& options) {
  const ConfidentSides sides{view, segmentation, static_cast<std::size_t>(structure.num_classes())};
  SensorPoints points;
  points.side_points = SampleSidePoints(sides, options.max_side_points);
  points.edge_points =
      EvenSubset(FindSilhouettes(sides), static_cast<std::size_t>(options.max_edge_points));
  return points;
}

}  // namespace volalign

#include "core/geometry/kd_tree.h"

#include <cmath>
#include <cstdint>
#include <nanoflann.hpp>
#include <utility>

namespace volalign {

namespace {

/// nanoflann's result set for one neighbour within a distance.
struct NearestWithin {
  using DistanceType = double;
  using IndexType = std::uint32_t;

  explicit NearestWithin(double max_distance)
      : worst(
            std::nextafter(max_distance * max_distance, std::numeric_limits<double>::infinity())) {}
  double worstDist() const { return worst; }
  bool addPoint(double squared_distance, std::uint32_t index) {
    if (!(squared_distance < worst)) return true;  // the limit fell since its leaf was opened
    nearest = {static_cast<int>(index), squared_distance};
    worst = squared_distance;
    return true;
  }
  bool full() const { return nearest.index >= 0; }
  std::size_t size() const { return full() ? 1 : 0; }
  bool empty() const { return !full(); }
  void sort() const {}

  KdTree::Neighbour nearest;
  double worst;  // only nearer points are taken
};

}  // namespace

struct KdTree::Index {
  struct Points {
    std::vector<Eigen::Vector3d> points;
    std::size_t kdtree_get_point_count() const { return points.size(); }
    double kdtree_get_pt(std::size_t i, std::size_t d) const {
      return points[i][static_cast<Eigen::Index>(d)];
    }
    template <class Box>
    bool kdtree_get_bbox(Box&) const {
      return false;
    }
  };
  using Tree =
      nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Points>, Points, 3>;
  explicit Index(std::vector<Eigen::Vector3d> from)
      : points{std::move(from)},
        tree(3, points, nanoflann::KDTreeSingleIndexAdaptorParams(kLeafSize)) {
    tree.buildIndex();
  }
  static constexpr std::size_t kLeafSize = 20;
  Points points;
  Tree tree;
};

KdTree::KdTree(std::vector<Eigen::Vector3d> points)
    : index_(std::make_unique<Index>(std::move(points))) {}
KdTree::~KdTree() = default;
KdTree::KdTree(KdTree&&) noexcept = default;
KdTree& KdTree::operator=(KdTree&&) noexcept = default;

KdTree::Neighbour KdTree::Nearest(const Eigen::Vector3d& p, double max_distance) const {
  NearestWithin found(max_distance);
  index_->tree.findNeighbors(found, p.data(), {});
  return found.nearest;
}

}  // namespace volalign

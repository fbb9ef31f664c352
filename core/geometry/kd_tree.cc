#include "core/geometry/kd_tree.h"

#include <cmath>
#include <cstdint>
#include <nanoflann.hpp>
#include <utility>

namespace volalign {

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
  std::uint32_t index = 0;
  // nanoflann takes points that are nearer than what the list of results ends with.
  double squared = 0;
  nanoflann::KNNResultSet<double, std::uint32_t> found(1);
  found.init(&index, &squared);
  squared = std::nextafter(max_distance * max_distance, std::numeric_limits<double>::infinity());
  index_->tree.findNeighbors(found, p.data(), {});
  return found.full() ? Neighbour{static_cast<int>(index), squared} : Neighbour{};
}

}  // namespace volalign

#pragma once

#include <Eigen/Core>
#include <limits>
#include <memory>
#include <vector>

namespace volalign {

/// Nearest neighbours among points in space (nanoflann). Movable; several threads may search at
/// once.
class KdTree {
 public:
  explicit KdTree(std::vector<Eigen::Vector3d> points);
  ~KdTree();
  KdTree(KdTree&&) noexcept;
  KdTree& operator=(KdTree&&) noexcept;

  struct Neighbour {
    int index = -1;  ///< -1: no point is so near
    double squared_distance = 0;
  };
  /// The nearest point no farther from `p` than `max_distance`, a limit that saves most of the
  /// search.
  Neighbour Nearest(const Eigen::Vector3d& p,
                    double max_distance = std::numeric_limits<double>::infinity()) const;

 private:
  struct Index;
  std::unique_ptr<Index> index_;
};

}  // namespace volalign

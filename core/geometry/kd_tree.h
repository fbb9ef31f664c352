#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

namespace volalign {

/// Nearest neighbours among points in space (nanoflann). Movable; safe to ask from several threads.
class KdTree {
 public:
  explicit KdTree(std::vector<Eigen::Vector3d> points);
  ~KdTree();
  KdTree(KdTree&&) noexcept;
  KdTree& operator=(KdTree&&) noexcept;

  struct Neighbour {
    int index = -1;  ///< -1: the tree is empty
    double squared_distance = 0;
  };
  Neighbour Nearest(const Eigen::Vector3d& p) const;

 private:
  struct Index;
  std::unique_ptr<Index> index_;
};

}  // namespace volalign

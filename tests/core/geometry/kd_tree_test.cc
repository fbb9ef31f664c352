#include "core/geometry/kd_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "core/base/random.h"

namespace volalign::kd_tree_test {
namespace {

std::vector<Eigen::Vector3d> RandomPoints(std::uint64_t seed, int count) {
  RandomStream random(seed, 0, "points");
  std::vector<Eigen::Vector3d> points;
  points.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i)
    points.emplace_back(random.Normal(), random.Normal(), random.Normal());
  return points;
}

TEST(KdTree, FindsWhatASearchThroughAllPointsFinds) {
  const std::vector<Eigen::Vector3d> points = RandomPoints(1, 500);
  KdTree moved = KdTree(RandomPoints(2, 3));
  moved = KdTree(points);
  const KdTree tree = std::move(moved);
  for (const Eigen::Vector3d& p : RandomPoints(3, 200)) {
    double least = std::numeric_limits<double>::infinity();
    int nearest = -1;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double squared = (points[i] - p).squaredNorm();
      if (squared < least) {
        least = squared;
        nearest = static_cast<int>(i);
      }
    }
    EXPECT_EQ(tree.Nearest(p).index, nearest);
    EXPECT_DOUBLE_EQ(tree.Nearest(p).squared_distance, least);
    EXPECT_EQ(tree.Nearest(p, 1.001 * std::sqrt(least)).index, nearest);
    EXPECT_EQ(tree.Nearest(p, 0.999 * std::sqrt(least)).index, -1);
  }
}

TEST(KdTree, APointAtTheLargestDistanceIsNear) {
  const KdTree tree({Eigen::Vector3d(3, 0, 4)});
  EXPECT_EQ(tree.Nearest(Eigen::Vector3d::Zero(), 5).index, 0);
}

TEST(KdTree, OfNothingHasNoNeighbour) {
  EXPECT_EQ(KdTree({}).Nearest(Eigen::Vector3d::Zero()).index, -1);
}

}  // namespace
}  // namespace volalign::kd_tree_test

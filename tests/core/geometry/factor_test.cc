#include "core/geometry/factor.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>

namespace volalign::refine_internal::factor_test {
namespace {

TEST(Factor, SolvesWhereThereIsOne) {
  Eigen::Matrix3d matrix;
  matrix << 4, 1, 0, 1, 3, -1, 0, -1, 2;
  const auto factor = Factor(matrix);
  ASSERT_TRUE(factor.has_value());
  const Eigen::Vector3d b(1, 2, 3);
  EXPECT_LT((matrix * factor->solve(b) - b).norm(), 1e-12);
  EXPECT_NEAR(LogRoot(*factor), 0.5 * std::log(matrix.determinant()), 1e-12);
}

TEST(Factor, IsNothingElsewhere) {
  Eigen::Matrix2d indefinite;
  indefinite << 1, 2, 2, 1;
  EXPECT_FALSE(Factor(indefinite));
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 0.0, -1.0}) {
    Eigen::Matrix2d matrix = Eigen::Matrix2d::Identity();
    matrix(1, 1) = bad;
    EXPECT_FALSE(Factor(matrix)) << bad;
  }
}

}  // namespace
}  // namespace volalign::refine_internal::factor_test

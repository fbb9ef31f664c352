#include "core/base/statistics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/random.h"

namespace volalign::statistics_test {
namespace {

TEST(Quantile, IsAnElementOfTheSortedValues) {
  RandomStream random(1, 0, "values");
  for (const int n : {1, 2, 3, 10, 101}) {
    std::vector<double> values;
    values.reserve(static_cast<std::size_t>(n));
    for (int i = 0; i < n; ++i) values.push_back(random.Normal());
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    for (const double q : {0.0, 0.25, 0.5, 0.95, 1.0})
      EXPECT_EQ(Quantile(values, q), sorted[static_cast<std::size_t>(q * (n - 1))])
          << n << " " << q;
    EXPECT_EQ(Median(values), sorted[static_cast<std::size_t>(n / 2)]) << n;
  }
}

TEST(Quantile, OfTwoTakesTheLowerAndMedianTheUpper) {
  EXPECT_EQ(Quantile(std::vector<int>{7, 3}, 0.5), 3);
  EXPECT_EQ(Median(std::vector<int>{7, 3}), 7);
}

TEST(Quantile, OfNothingIsZero) {
  EXPECT_EQ(Quantile(std::vector<double>(), 0.5), 0);
  EXPECT_EQ(Median(std::vector<double>()), 0);
}

TEST(Median, TheMadOfANormalDistributionGivesItsStandardDeviation) {
  RandomStream random(2, 0, "normal");
  std::vector<double> deviations;
  deviations.reserve(100000);
  for (int i = 0; i < 100000; ++i) deviations.push_back(std::abs(2 * random.Normal()));
  EXPECT_NEAR(kMadToSigma * Median(deviations), 2, 0.03);  // 3 standard errors
}

}  // namespace
}  // namespace volalign::statistics_test

#include "infer/depth/share_odds.h"

#include <gtest/gtest.h>

#include <cmath>

namespace volalign::share_odds_test {
namespace {

// Polya's urn: one cell after the other, each of a colour with the proportion of what was in the
// urn and what was drawn before.
TEST(ShareModel, IsTheProbabilityOfDrawsFromAnUrn) {
  const ShareModel model{2.5, 0.75};
  double expected = 0;
  int drawn = 0, drawn_for = 0;
  for (const bool is_for : {true, true, false, true, false, false, true}) {
    const double share = (model.for_it + drawn_for) / (model.for_it + model.against + drawn);
    expected += std::log(is_for ? share : 1 - share);
    ++drawn;
    drawn_for += is_for ? 1 : 0;
  }
  EXPECT_NEAR(model.LogProbability(4, 3), expected, 1e-12);
}

// And the mean of s^n (1 - s)^m over shares s, for counts that are not whole, too.
TEST(ShareModel, IsTheMeanOverAllShares) {
  const ShareModel model{3, 2};  // density proportional to s^2 (1 - s), which is 12 times that
  const double cells_for = 4.3, cells_against = 1.7;
  constexpr int kSteps = 200000;
  double mean = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double s = (i + 0.5) / kSteps;
    mean += 12 * s * s * (1 - s) * std::pow(s, cells_for) * std::pow(1 - s, cells_against) / kSteps;
  }
  EXPECT_NEAR(model.LogProbability(cells_for, cells_against), std::log(mean), 1e-8);
}

TEST(ShareOdds, NothingSeenSaysNothingAndMoreSaysMore) {
  const ShareOdds odds{{50, 0.5}, {3, 1}};
  EXPECT_EQ(odds.LogOdds(0, 0), 0);
  EXPECT_GT(odds.LogOdds(10, 0), 0);
  EXPECT_GT(odds.LogOdds(20, 0), odds.LogOdds(10, 0));
  EXPECT_LT(odds.LogOdds(7, 3), 0);
  EXPECT_LT(odds.LogOdds(14, 6), odds.LogOdds(7, 3));
}

}  // namespace
}  // namespace volalign::share_odds_test

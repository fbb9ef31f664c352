#include "infer/depth/explain_ray.h"

#include <gtest/gtest.h>

#include <cmath>

namespace volalign::explain_ray_test {
namespace {

/// 10 mm of white noise at every depth.
DepthErrorModel TenMillimetres() {
  DepthErrorModel errors;
  errors.white_m = 0.01;
  errors.smooth_rad = 0.1;
  return errors;
}

constexpr CauseShares kUsual = {0.6, 0.2, 0.1, 0.1};

double Sum(const CauseShares& share) { return share[0] + share[1] + share[2] + share[3]; }

// Bayes' rule with the densities written out: at 2 m, sigma 12.5 mm of the sensor's 10 and the
// surface's 7.5, 30 mm off.
TEST(Explain, IsTheProbabilityOfEachCause) {
  const double normal = std::exp(-0.5 * 2.4 * 2.4) / (0.0125 * std::sqrt(2 * M_PI));
  const double before = 0.2 / 2, behind = 0.1 * std::exp(-0.03 / 1.5) / 1.5;
  const CauseShares near = Explain({2, 0.0075}, {1.97, 0.03}, TenMillimetres(), kUsual);
  EXPECT_NEAR(near[0], 0.6 * normal / (0.6 * normal + before), 1e-12);
  EXPECT_NEAR(near[1], before / (0.6 * normal + before), 1e-12);
  EXPECT_EQ(near[2], 0);
  const CauseShares far = Explain({2, 0.0075}, {2.03, 0.03}, TenMillimetres(), kUsual);
  EXPECT_NEAR(far[0], 0.6 * normal / (0.6 * normal + behind), 1e-12);
  EXPECT_NEAR(far[2], behind / (0.6 * normal + behind), 1e-12);
  EXPECT_EQ(far[1], 0);
}

TEST(Explain, SharesAddUpToOneAndTheSurfaceGivesWayWithDistance) {
  double before = 1;
  for (double off = 0; off < 0.2; off += 0.005) {
    const CauseShares share = Explain({3, 0.01}, {3 + off, off}, TenMillimetres(), kUsual);
    EXPECT_NEAR(Sum(share), 1, 1e-12) << off;
    EXPECT_LE(share[0], before) << off;
    before = share[0];
  }
  EXPECT_LT(before, 1e-9);
}

TEST(Explain, AGrazingRayIsJudgedByThePointsDistance) {
  // 30 cm deeper along the ray, but 5 mm off the surface.
  EXPECT_GT(Explain({2, 0.01}, {2.3, 0.005}, TenMillimetres(), kUsual)[0], 0.99);
}

TEST(Explain, NoDepthIsMissingAndFarOffIsNotTheSurface) {
  EXPECT_EQ(Explain({2, 0.01}, {0, 0}, TenMillimetres(), kUsual), (CauseShares{0, 0, 0, 1}));
  // Where the normal density is no number that differs from 0, and nothing else is usual.
  const CauseShares alone = {1, 0, 0, 0};
  EXPECT_EQ(Explain({2, 0}, {9, 7}, TenMillimetres(), alone), (CauseShares{0, 0, 1, 0}));
  EXPECT_EQ(Explain({2, 0}, {1, 1}, TenMillimetres(), alone), (CauseShares{0, 1, 0, 0}));
}

}  // namespace
}  // namespace volalign::explain_ray_test

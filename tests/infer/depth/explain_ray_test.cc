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

double Sum(const CauseShares& share) { return share[0] + share[1] + share[2] + share[3]; }

// Bayes' rule with the densities written out: at 2 m, sigma 12.5 mm of the sensor's 10 and the
// surface's 7.5, 30 mm off; 2 of 1,000 rays measure what is before it, or behind it.
TEST(Explain, IsTheProbabilityOfEachCause) {
  const double normal = std::exp(-0.5 * 2.4 * 2.4) / (0.0125 * std::sqrt(2 * M_PI));
  const double before = 0.002 / 2, behind = 0.002 * std::exp(-0.03 / 2) / 2;
  const CauseShares near = Explain({2, 0.0075}, {1.97, 0.03}, TenMillimetres());
  EXPECT_NEAR(near[0], normal / (normal + before), 1e-12);
  EXPECT_NEAR(near[1], before / (normal + before), 1e-12);
  EXPECT_EQ(near[2], 0);
  const CauseShares far = Explain({2, 0.0075}, {2.03, 0.03}, TenMillimetres());
  EXPECT_NEAR(far[0], normal / (normal + behind), 1e-12);
  EXPECT_NEAR(far[2], behind / (normal + behind), 1e-12);
  EXPECT_EQ(far[1], 0);
}

TEST(Explain, SharesAddUpToOneAndTheSurfaceGivesWayWithDistance) {
  double before = 1;
  for (double off = 0; off < 0.2; off += 0.005) {
    const CauseShares share = Explain({3, 0.01}, {3 + off, off}, TenMillimetres());
    EXPECT_NEAR(Sum(share), 1, 1e-12) << off;
    EXPECT_LE(share[0], before) << off;
    before = share[0];
  }
  EXPECT_LT(before, 1e-9);
}

TEST(Explain, AGrazingRayIsJudgedByThePointsDistance) {
  // 30 cm deeper along the ray, but 5 mm off the surface.
  EXPECT_GT(Explain({2, 0.01}, {2.3, 0.005}, TenMillimetres())[0], 0.99);
}

TEST(Explain, NoDepthIsMissingAndFarOffIsNotTheSurface) {
  EXPECT_EQ(Explain({2, 0.01}, {0, 0}, TenMillimetres()), (CauseShares{0, 0, 0, 1}));
  EXPECT_EQ(Explain({2, 0}, {1, 1}, TenMillimetres()), (CauseShares{0, 1, 0, 0}));
  // Where no density differs from 0, a frame in other units.
  EXPECT_EQ(Explain({2, 0}, {9000, 8998}, TenMillimetres()), (CauseShares{0, 0, 1, 0}));
}

}  // namespace
}  // namespace volalign::explain_ray_test

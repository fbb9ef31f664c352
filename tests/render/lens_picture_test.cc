#include "render/lens_picture.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace volalign::lens_picture_test {
namespace {

TEST(PlanLensPicture, ThePinholePictureHasAllRaysWithTheirNeighbours) {
  const LensPicture picture = PlanLensPicture({40, 30, 30, 30, 19.2, 14.7, {-0.15, 0.02, 0, 0}});
  const Intrinsics& pinhole = picture.pinhole;
  EXPECT_TRUE(pinhole.distortion.empty());
  EXPECT_EQ(pinhole.fx, 60);  // finer than the middle of the lens's picture
  double left = 1e9, right = -1e9;
  for (const Eigen::Vector2f& ray : picture.rays.rays) {
    const double u = pinhole.fx * ray.x() + pinhole.cx, v = pinhole.fy * ray.y() + pinhole.cy;
    EXPECT_GE(u, 0);
    EXPECT_LT(u, pinhole.width - 1);
    EXPECT_GE(v, 0);
    EXPECT_LT(v, pinhole.height - 1);
    left = std::min(left, u);
    right = std::max(right, u);
  }
  // Not much more than these.
  EXPECT_LT(left, 4);
  EXPECT_GT(right, pinhole.width - 6);
}

}  // namespace
}  // namespace volalign::lens_picture_test

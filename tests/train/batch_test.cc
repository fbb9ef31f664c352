#include "train/batch.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/error.h"

namespace volalign::batch_test {
namespace {

Sample Blank(const Intrinsics& k) {
  Sample s;
  s.intrinsics = k;
  s.depth = DepthImage(k.width, k.height, 2.0F);
  s.labels = LabelImage(k.width, k.height, 3);
  return s;
}

TEST(Collate, RaysAreThoseOfEachSamplesLens) {
  const Intrinsics pinhole{24, 20, 21, 22, 11.3, 9.1, {}};
  Intrinsics lens = pinhole;
  lens.distortion = {-0.3, 0.05, 0, 0};
  const Batch batch = Collate({Blank(pinhole), Blank(lens)});
  ASSERT_EQ(batch.rays.sizes(), at::IntArrayRef({2, 2, 20, 24}));
  for (int v = 0; v < 20; ++v) {
    for (int u = 0; u < 24; ++u) {
      const double xd = (u - 11.3) / 21, yd = (v - 9.1) / 22;
      EXPECT_NEAR(batch.rays[0][0][v][u].item<float>(), xd, 1e-6);
      EXPECT_NEAR(batch.rays[0][1][v][u].item<float>(), yd, 1e-6);
      // OpenCV's model, forwards.
      const double x = batch.rays[1][0][v][u].item<float>();
      const double y = batch.rays[1][1][v][u].item<float>();
      const double r2 = x * x + y * y, radial = 1 - 0.3 * r2 + 0.05 * r2 * r2;
      EXPECT_NEAR(x * radial, xd, 1e-6);
      EXPECT_NEAR(y * radial, yd, 1e-6);
    }
  }
}

TEST(Collate, PixelsBeyondALensesFoldHaveNoDepth) {
  // r (1 - 0.5 r^2) rises up to 0.5443.
  const Intrinsics k{24, 20, 22, 22, 11.5, 9.5, {-0.5, 0, 0, 0}};
  const Batch batch = Collate({Blank(k)});
  int without = 0;
  for (int v = 0; v < 20; ++v) {
    for (int u = 0; u < 24; ++u) {
      const bool folded = std::hypot(u - 11.5, v - 9.5) / 22 > 0.5443;
      EXPECT_EQ(batch.depth[0][0][v][u].item<float>(), folded ? 0.0F : 2.0F) << u << " " << v;
      EXPECT_TRUE(std::isfinite(batch.rays[0][0][v][u].item<float>()));
      without += folded;
    }
  }
  EXPECT_GT(without, 20);
}

TEST(Collate, ImagesOfOtherSizesAreAnError) {
  const Intrinsics k{24, 20, 22, 22, 11.5, 9.5, {}};
  Sample other = Blank(k);
  other.intrinsics.width = 23;
  EXPECT_THROW(Collate({Blank(k), other}), Error);
  EXPECT_THROW(Collate({}), Error);
}

}  // namespace
}  // namespace volalign::batch_test

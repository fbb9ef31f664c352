#include "core/base/noise_fields.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/random.h"
#include "tests/core/base/pixels.h"

namespace volalign::noise_fields_test {
namespace {

constexpr int kWidth = 77, kHeight = 9, kPixels = kWidth * kHeight;

TEST(FieldLoops, DrawTheNumbersOfPixelRandom) {
  RandomStream stream(3, 4, "test");
  const PixelRandom pixel(stream);
  const KernelSets<FieldLoops>& all = AllFieldLoops();
  for (int set = 0; set < all.count; ++set) {
    std::vector<float> uniform(kPixels), normal(kPixels);
    all.sets[set].uniform(pixel.key(), 1000, kPixels, uniform.data());
    all.sets[set].normal(pixel.key(), 1000, kPixels, normal.data());
    for (std::size_t i = 0; i < kPixels; ++i) {
      ASSERT_EQ(uniform[i], pixel.Uniform(1000 + i)) << set;
      ASSERT_EQ(normal[i], pixel.Normal(1000 + i)) << set;
    }
  }
}

TEST(FieldLoops, GiveTheSameByEveryInstructionSet) {
  const KernelSets<FieldLoops>& all = AllFieldLoops();
  for (const int width : {1, 2, 33, kWidth}) {
    for (const double correlation : {1.0, 4.7, 60.0}) {
      std::vector<Image<float>> fields, smooth;
      for (int set = 0; set < all.count; ++set) {
        RandomStream random(3, 4, "test");
        fields.push_back(SmoothField(width, kHeight, correlation, random, all.sets[set]));
        smooth.push_back(fields.back());
        SmoothUnitNoise(1.2, 0.9, &smooth.back(), all.sets[set]);
        EXPECT_TRUE(fields.back() == fields[0] && smooth.back() == smooth[0]) << set;
      }
    }
  }
}

// Against the sums that are meant, a pixel at a time, where the ends have themselves for
// neighbours.
TEST(SmoothUnitNoise, IsAThreeTapGaussianEachWay) {
  RandomStream random(3, 4, "test");
  const PixelRandom pixel(random);
  Image<float> noise(5, 4);
  for (std::size_t i = 0; i < noise.size(); ++i) noise[i] = pixel.Normal(i);
  const double side = std::exp(-0.5 / (1.2 * 1.2)), norm = 1 / std::sqrt(1 + 2 * side * side);
  const auto along = [&](int u, int v) {
    const float left = noise(std::max(u - 1, 0), v), right = noise(std::min(u + 1, 4), v);
    return norm * (noise(u, v) + side * (left + right));
  };
  std::vector<double> expected;
  for (const auto [u, v] : Pixels(5, 4)) {
    const double above = along(u, std::max(v - 1, 0)), below = along(u, std::min(v + 1, 3));
    expected.push_back(norm * (along(u, v) + side * (above + below)));
  }
  SmoothUnitNoise(1.2, 1.2, &noise);
  for (std::size_t i = 0; i < noise.size(); ++i) EXPECT_NEAR(noise[i], expected[i], 1e-5) << i;
}

}  // namespace
}  // namespace volalign::noise_fields_test

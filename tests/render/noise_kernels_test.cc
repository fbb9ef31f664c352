#include "render/noise_kernels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace volalign::noise::noise_kernels_test {
namespace {

// What the kernels stand for: a pixel at a time, as one would write it down. Every instruction set
// has to give the same to the last bit.

constexpr int kWidth = 77, kHeight = 9;
constexpr std::size_t kRow = kWidth, kPixels = kRow * kHeight;
using Floats = std::vector<float>;
using Bytes = std::vector<std::uint8_t>;

class NoiseKernelsTest : public testing::Test {
 protected:
  float Uniform(float low, float high) {
    return std::uniform_real_distribution<float>(low, high)(random_);
  }
  Floats Draw(std::size_t count, float low, float high) {
    Floats all(count);
    for (float& x : all) x = Uniform(low, high);
    return all;
  }
  /// Depth in steps, 0 in a tenth of the pixels.
  Floats DrawDepth(std::size_t count) {
    Floats all = Draw(count, 0.3F, 6);
    for (float& z : all) {
      if (Uniform(0, 1) < 0.1F) z = 0;
    }
    return all;
  }
  Bytes DrawBits(std::size_t count) {
    Bytes all(count);
    for (std::uint8_t& x : all) x = Uniform(0, 1) < 0.8F;
    return all;
  }
  /// Runs of faces, some of which are none.
  std::vector<std::uint16_t> DrawFaces(std::size_t count) {
    std::vector<std::uint16_t> all(count);
    for (std::size_t i = 0; i < count; ++i) {
      all[i] =
          i > 0 && Uniform(0, 1) < 0.7F ? all[i - 1] : static_cast<std::uint16_t>(Uniform(0, 5));
    }
    return all;
  }
  template <class Check>
  static void ForEachSet(const Check& check) {
    const KernelSets<NoiseKernels>& all = AllNoiseKernels();
    for (int i = 0; i < all.count; ++i) {
      SCOPED_TRACE(all.sets[i].name);
      check(all.sets[i]);
    }
  }

  std::mt19937 random_{17};
};

TEST_F(NoiseKernelsTest, FindTheSurfaceThatTheWindowTakes) {
  const Floats depth = DrawDepth(kPixels), du = Draw(kWidth, -3, 3), dv = Draw(kWidth, -3, 3);
  const Floats dither = Draw(kWidth, 0, 1);
  const float reach = 1.3F, step = 0.05F;
  ForEachSet([&](const NoiseKernels& kernels) {
    for (int v = 0; v < kHeight; ++v) {
      std::vector<std::int32_t> source(kWidth);
      Bytes nearer(kWidth);
      kernels.fatten(depth.data(), kWidth, kHeight, v, du.data(), dv.data(), dither.data(), reach,
                     step, source.data(), nearer.data());
      for (int u = 0; u < kWidth; ++u) {
        const auto i = static_cast<std::size_t>(u);
        const float moved = dither[i] - 0.5F;
        const int p =
            std::clamp(u + static_cast<int>(std::nearbyint(reach * du[i] + moved)), 0, kWidth - 1);
        const int q =
            std::clamp(v + static_cast<int>(std::nearbyint(reach * dv[i] + moved)), 0, kHeight - 1);
        const float here = depth[static_cast<std::size_t>(v) * kRow + static_cast<std::size_t>(u)];
        const float there = depth[static_cast<std::size_t>(q) * kRow + static_cast<std::size_t>(p)];
        ASSERT_EQ(source[i], q * kWidth + p);
        ASSERT_EQ(nearer[i] != 0, there > 0 && (here == 0 || there < here - step));
      }
    }
  });
}

TEST_F(NoiseKernelsTest, FindEdgesBetweenFaces) {
  const std::vector<std::uint16_t> faces = DrawFaces(kWidth), below = DrawFaces(kWidth);
  ForEachSet([&](const NoiseKernels& kernels) {
    Bytes edges(kWidth);
    kernels.face_edges(faces.data(), below.data(), kWidth, edges.data());
    for (std::size_t u = 0; u < kWidth; ++u) {
      ASSERT_EQ(edges[u] & 1, u + 1 < kWidth && faces[u] != faces[u + 1]);
      ASSERT_EQ(edges[u] >> 1, faces[u] != below[u]);
    }
  });
}

TEST_F(NoiseKernelsTest, FindPixelsBetweenTheirNeighbours) {
  Floats image = Draw(3 * kRow, 0, 3);
  for (std::size_t i = 0; i < image.size(); i += 7) image[i] = 0;
  const float* const here = image.data() + kWidth;
  const auto mixed = [](float a, float m, float b) {
    const float jump = b - a;
    if (std::abs(jump) < 0.3F || a <= 0 || b <= 0) return false;
    const float share = (m - a) / jump;
    return share > 0.15F && share < 0.85F;
  };
  ForEachSet([&](const NoiseKernels& kernels) {
    for (const bool has_rows : {true, false}) {
      Bytes found(kWidth);
      kernels.mixed(has_rows ? here - kWidth : nullptr, here, has_rows ? here + kWidth : nullptr,
                    kWidth, 0.3F, 0.15F, 0.85F, found.data());
      for (int u = 0; u < kWidth; ++u) {
        const bool in_row = u > 0 && u + 1 < kWidth && mixed(here[u - 1], here[u], here[u + 1]);
        const bool in_column = has_rows && mixed(here[u - kWidth], here[u], here[u + kWidth]);
        ASSERT_EQ(found[static_cast<std::size_t>(u)], in_row || in_column);
      }
    }
  });
}

TEST_F(NoiseKernelsTest, RoundToTheMillimetre) {
  Floats depth = DrawDepth(kPixels);
  depth[1] = -0.1F;
  depth[2] = 4.0005F;
  const Bytes keep = DrawBits(kPixels);
  ForEachSet([&](const NoiseKernels& kernels) {
    Floats rounded = depth;
    Bytes labels(kPixels, 3);
    kernels.round(keep.data(), kPixels, rounded.data(), labels.data());
    for (std::size_t i = 0; i < kPixels; ++i) {
      const bool kept = keep[i] && depth[i] > 0;
      ASSERT_EQ(rounded[i], kept ? std::nearbyint(depth[i] * 1000) * 0.001F : 0);
      ASSERT_EQ(labels[i], kept ? 3 : 0);
    }
  });
}

}  // namespace
}  // namespace volalign::noise::noise_kernels_test

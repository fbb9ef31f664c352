#include "render/noise_kernels.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
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

TEST_F(NoiseKernelsTest, MatchAsTheStereoModelSays) {
  const MatchFigures f{2.5F, 2.0F, 0.35F, 8.0F, 0.22F, 0.9F, 0.4F, 0.5F};
  for (int round = 0; round < 200; ++round) {
    const std::vector<std::uint16_t> faces = DrawFaces(kWidth);
    const Floats rays = Draw(2 * kRow, -0.7F, 0.7F), height = Draw(kWidth, 0.1F, 4);
    const Floats quality = Draw(kWidth, -1, 3), loss = Draw(kWidth, 0, 0.5F);
    const Floats coarse = Draw(kWidth, -2, 2), fine = Draw(kWidth, -2, 2);
    const Floats error = Draw(kWidth, -0.5F, 0.5F), depth = DrawDepth(kWidth);
    const Bytes keep = DrawBits(kWidth);
    const MatchRow row{kWidth,      faces.data(),  rays.data(), height.data(), quality.data(),
                       loss.data(), coarse.data(), fine.data(), error.data(),  13.0F,
                       51.9F,       31.5F,         0.5F};
    Floats expected = depth;
    Bytes kept = keep;
    float covered = 1e9F;
    for (int u = kWidth - 1; u >= 0; --u) {
      const auto i = static_cast<std::size_t>(u);
      const float z = depth[i];
      if (faces[i] == 0 || z <= 0) {
        kept[i] = 0;
        continue;
      }
      const float x = rays[2 * i], y = rays[2 * i + 1];
      const float disparity = row.image_fb / z;
      const float column = static_cast<float>(u) - disparity;
      const bool occluded = column > covered + row.margin;
      covered = std::min(covered, column);
      const float cosine = std::min(height[i] / (z * std::sqrt(x * x + y * y + 1)), 1.0F);
      const float offset = quality[i] - loss[i] * std::max(z - f.full_quality_distance, 0.0F);
      const float confidence = offset - f.grazing_loss * std::max(f.grazing_cosine - cosine, 0.0F) -
                               f.steep_loss * std::max(f.steep_cosine - cosine, 0.0F) +
                               f.coarse_weight * coarse[i] + f.fine_weight * fine[i];
      if (occluded || column < 0 || confidence < 0 || disparity > row.largest_disparity) {
        kept[i] = 0;
        continue;
      }
      expected[i] = row.native_fb / std::max(row.native_fb / z + error[i], f.least_disparity);
    }
    ForEachSet([&](const NoiseKernels& kernels) {
      Floats measured = depth, scratch(3 * kRow);
      Bytes found = keep;
      kernels.match(row, f, measured.data(), found.data(), scratch.data());
      ASSERT_EQ(found, kept);
      for (std::size_t i = 0; i < kWidth; ++i) {
        ASSERT_EQ(found[i] ? measured[i] : 0, found[i] ? expected[i] : 0);
      }
    });
  }
}

TEST_F(NoiseKernelsTest, MeasureAsTheTimeOfFlightModelSays) {
  const TofFigures f{0.00012F, 0.0001F, 0.15F, 0.125F, 16.0F};
  for (int round = 0; round < 200; ++round) {
    const std::vector<std::uint16_t> faces = DrawFaces(kWidth);
    Floats depth = DrawDepth(kWidth);
    depth[5] = 17;
    const Floats rays = Draw(2 * kRow, -0.7F, 0.7F), height = Draw(kWidth, 0, 4);
    const Floats reflectivity = Draw(kWidth, 0, 0.1F), limit = Draw(kWidth, 1, 2);
    const Floats warp = Draw(kWidth, -2, 2), grain = Draw(kWidth, -2, 2);
    const Floats patches = Draw(kWidth, -2, 2);
    const Bytes keep = DrawBits(kWidth);
    const TofRow row{kWidth,         faces.data(),  depth.data(),
                     rays.data(),    height.data(), reflectivity.data(),
                     limit.data(),   warp.data(),   grain.data(),
                     patches.data(), 0.003F,        0.004F,
                     1.1F,           0.003F};
    ForEachSet([&](const NoiseKernels& kernels) {
      Floats error(kWidth);
      Bytes kept = keep;
      kernels.measure(row, f, error.data(), kept.data());
      for (std::size_t i = 0; i < kWidth; ++i) {
        if (faces[i] == 0 || depth[i] == 0) {
          ASSERT_EQ(kept[i], faces[i] == 0 ? 0 : kept[i]);
          continue;
        }
        const float z = depth[i], x = rays[2 * i], y = rays[2 * i + 1];
        const float range = z * std::sqrt(x * x + y * y + 1);
        const float cosine = std::max(height[i] / range, 0.01F);
        const float inverse = 1 / std::max(cosine, f.least_cosine);
        const float grazing = inverse * (0.7F + 0.3F * std::sqrt(inverse));
        ASSERT_EQ(error[i],
                  row.bias + row.warp_rms * warp[i] +
                      row.white * (f.white_noise + f.white_noise_slope * z) * grazing * grain[i]);
        const float amplitude = reflectivity[i] * cosine / (range * range);
        const float wave = 1 + f.patch_wave * patches[i];
        const bool lost = amplitude < row.threshold * wave * wave * wave * wave ||
                          patches[i] > limit[i] || z > f.farthest;
        ASSERT_EQ(kept[i], lost ? 0 : keep[i]);
      }
    });
  }
}

TEST_F(NoiseKernelsTest, AddWhatTheNearestSeamDoes) {
  using RowMajor3f = Eigen::Matrix<float, 3, 3, Eigen::RowMajor>;
  for (int round = 0; round < 200; ++round) {
    const Floats depth = DrawDepth(kWidth), rays = Draw(2 * kRow, -0.7F, 0.7F);
    const Floats before = Draw(kWidth, -0.01F, 0.01F);
    const auto turn = [&]() -> Eigen::Matrix3f {
      return Eigen::Quaternionf(Uniform(0.1F, 1), Uniform(-1, 1), Uniform(-1, 1), Uniform(-1, 1))
          .normalized()
          .toRotationMatrix();
    };
    const auto draw = [&](float low, float high) -> Eigen::Vector3f {
      return {Uniform(low, high), Uniform(low, high), Uniform(low, high)};
    };
    struct Box {
      Eigen::Matrix3f rotation;
      Eigen::Vector3f centre, half;
      float reach_squared;
    };
    SeamRow row{};
    const Eigen::Matrix3f rotation = turn();
    const Eigen::Vector3f eye = draw(-1, 1);
    std::vector<Box> boxes;
    std::vector<SeamBox> for_kernels;
    for (int b = 0; b < 4; ++b) {
      const Eigen::Vector3f half = draw(0.1F, 0.5F);
      // In front of the sensor, where the pixels' points are.
      const Eigen::Vector3f centre = eye + rotation * Eigen::Vector3f(0, 0, 2) + draw(-0.5F, 0.5F);
      const float reach = half.norm() + 0.3F;
      boxes.push_back({turn(), centre, half, reach * reach});
      SeamBox box{};
      Eigen::Map<RowMajor3f>(box.rotation) = boxes.back().rotation;
      Eigen::Map<Eigen::Vector3f>(box.centre) = centre;
      Eigen::Map<Eigen::Vector3f>(box.half) = half;
      box.reach_squared = reach * reach;
      for_kernels.push_back(box);
    }
    row.count = kWidth;
    row.depth = depth.data();
    row.rays = rays.data();
    Eigen::Map<RowMajor3f>(row.rotation) = rotation;
    Eigen::Map<Eigen::Vector3f>(row.eye) = eye;
    row.boxes = for_kernels.data();
    row.num_boxes = 4;
    row.rising = static_cast<std::uint64_t>(round % 16);
    row.meets_floor = round % 3 == 0;
    row.floor = Uniform(-1, 1);
    row.multipath = 0.02F;
    row.multipath_reach = 0.3F;
    row.fill = 0.015F;
    row.fill_reach = 0.06F;
    Floats expected = before;
    for (std::size_t i = 0; i < kWidth; ++i) {
      const Eigen::Vector3f p =
          eye + depth[i] * (rotation * Eigen::Vector3f(rays[2 * i], rays[2 * i + 1], 1));
      float seam = row.multipath_reach;
      for (std::size_t b = 0; b < boxes.size(); ++b) {
        if ((row.rising >> b & 1) == 0) continue;
        const Eigen::Vector3f d = boxes[b].centre - p;
        if (d.squaredNorm() > boxes[b].reach_squared) continue;
        const Eigen::Vector3f outside =
            ((boxes[b].rotation * d).cwiseAbs() - boxes[b].half).cwiseMax(0.0F);
        seam = std::min(seam, outside.norm());
      }
      if (row.meets_floor) seam = std::min(seam, std::max(p.y() - row.floor, 0.0F));
      expected[i] += row.multipath * (1 - seam / row.multipath_reach) -
                     row.fill * std::max(1 - seam / row.fill_reach, 0.0F);
    }
    ForEachSet([&](const NoiseKernels& kernels) {
      Floats error = before, scratch(4 * kRow);
      kernels.seams(row, error.data(), scratch.data());
      ASSERT_EQ(error, expected);
    });
  }
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

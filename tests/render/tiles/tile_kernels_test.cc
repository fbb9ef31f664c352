#include "render/tiles/tile_kernels.h"

#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

namespace volalign::tiles::tile_kernels_test {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
constexpr int kTiles = 32;

/// Random faces, rays and what a tile shows before; every kernel's output as bytes.
class Inputs {
 public:
  Inputs() {
    for (float& x : x_) x = Uniform(-1, 1);
    for (float& y : y_) y = Uniform(-1, 1);
    x_[5] = y_[5] = kNone;
    for (int i = 0; i < kTiles; ++i) {
      low_x_[Index(i)] = Uniform(-1, 1);
      low_y_[Index(i)] = Uniform(-1, 1);
      high_x_[Index(i)] = low_x_[Index(i)] + Uniform(0, 0.1F);
      high_y_[Index(i)] = low_y_[Index(i)] + Uniform(0, 0.1F);
    }
    low_x_[3] = high_x_[3] = low_y_[3] = high_y_[3] = kNone;
    for (float& w : inverse_) w = Uniform(0, 1);
    inverse_[7] = 0;
    for (std::uint32_t& id : ids_) id = static_cast<std::uint32_t>(random_()) & 0xFFFFFFU;
  }

  TileFace Face(std::uint32_t num_edges) {
    TileFace face{};
    face.inverse = Function();
    face.least = Uniform(0.1F, 0.3F);
    face.most = face.least + Uniform(0.1F, 1);
    face.num_edges = num_edges;
    for (std::uint32_t k = 0; k < num_edges; ++k) face.edges[k] = Function();
    face.id = static_cast<std::uint32_t>(random_());
    return face;
  }

  std::vector<unsigned char> Outputs(const TileKernels& kernels, const TileFace& face,
                                     std::int32_t crossing, int columns) const {
    std::array<float, kTiles> nearest{};
    std::array<std::int32_t, kTiles> cut{};
    kernels.cover(face, {low_x_.data(), high_x_.data(), low_y_.data(), high_y_.data()}, kTiles,
                  nearest.data(), cut.data());
    auto inverse = inverse_;
    auto ids = ids_;
    const float least = kernels.paint(
        face, crossing, {x_.data(), y_.data(), kTileWidth, kTileWidth}, inverse.data(), ids.data());
    std::array<float, kTilePixels> depth{};
    std::array<std::uint8_t, kTilePixels> labels{};
    std::array<std::uint16_t, kTilePixels> faces{};
    kernels.finish(inverse.data(), ids.data(),
                   {depth.data(), labels.data(), faces.data(), kTileWidth, columns, kTileHeight});
    std::vector<unsigned char> bytes;
    const auto append = [&](const void* data, std::size_t size) {
      const auto* first = static_cast<const unsigned char*>(data);
      bytes.insert(bytes.end(), first, first + size);
    };
    append(nearest.data(), sizeof nearest);
    append(cut.data(), sizeof cut);
    append(inverse.data(), sizeof inverse);
    append(ids.data(), sizeof ids);
    append(&least, sizeof least);
    append(depth.data(), sizeof depth);
    append(labels.data(), sizeof labels);
    append(faces.data(), sizeof faces);
    return bytes;
  }

 private:
  static std::size_t Index(int i) { return static_cast<std::size_t>(i); }
  float Uniform(float low, float high) {
    return std::uniform_real_distribution<float>(low, high)(random_);
  }
  Linear Function() { return {Uniform(-1, 1), Uniform(-1, 1), Uniform(-0.2F, 1)}; }

  std::mt19937 random_{5};
  std::array<float, kTilePixels> x_{}, y_{}, inverse_{};
  std::array<std::uint32_t, kTilePixels> ids_{};
  std::array<float, kTiles> low_x_{}, high_x_{}, low_y_{}, high_y_{};
};

TEST(TileKernelsTest, AllInstructionSetsGiveTheSameBits) {
  const KernelSets<TileKernels>& all = AllKernels();
  ASSERT_GE(all.count, 1);
  Inputs inputs;
  for (int i = 0; i < 300; ++i) {
    const TileFace face = inputs.Face(i % 3 == 0 ? 6 : 4);
    const int columns = i % 2 == 0 ? kTileWidth : 1 + i % kTileWidth;
    const auto expected = inputs.Outputs(all.sets[0], face, i % 64, columns);
    for (int set = 1; set < all.count; ++set) {
      ASSERT_EQ(inputs.Outputs(all.sets[set], face, i % 64, columns), expected)
          << all.sets[set].name << ", " << i;
    }
  }
}

}  // namespace
}  // namespace volalign::tiles::tile_kernels_test

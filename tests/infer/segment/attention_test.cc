#include "infer/segment/attention.h"

#include <ATen/ops/from_blob.h>
#include <c10/core/GradMode.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/random.h"
#include "core/nn/checkpoint.h"
#include "core/nn/network.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::attention_test {
namespace {

using testing_infer::Kinect;
using testing_infer::PaperStructure;

class AttentionTest : public ::testing::Test {
 protected:
  std::filesystem::path Save(bool attention) {
    StructureNetOptions options;
    options.base_channels = 4;
    options.attention = attention;
    net_ = StructureNet(options);
    net_->eval();
    CheckpointMeta meta;
    meta.network = options;
    meta.structure = PaperStructure();
    meta.focal_px = {117, 127};
    meta.image_sizes = {{160, 144}};
    SaveCheckpoint(folder_ / "model.pt", net_, meta, false);
    return folder_ / "model.pt";
  }

  static DepthImage RandomDepth(int width, int height) {
    RandomStream random(1, 0, "attention_test");
    DepthImage depth(width, height);
    for (float& z : depth) z = static_cast<float>(random.Uniform(0, 4));
    return depth;
  }

  /// Of the network's size, [1,1,H/16,W/16].
  at::Tensor Direct(const DepthImage& depth) {
    const c10::NoGradGuard no_grad;
    const at::Tensor input = at::from_blob(const_cast<float*>(depth.data()),
                                           {1, 1, depth.height(), depth.width()}, at::kFloat);
    return net_->ForwardWithAttention(EncodeDepth(input, net_->options().input)).attention;
  }

  TempFolder folder_;
  StructureNet net_{nullptr};
};

TEST_F(AttentionTest, IsTheNetworksAtEachPixelAndTurnedBack) {
  const auto file = Save(true);
  const Intrinsics k = Kinect().Resized(160, 144);
  const DepthImage depth = RandomDepth(160, 144);
  for (int turns = 0; turns < 4; ++turns) {
    const Image<float> map = AttentionMaps(file, {{&depth, &k, turns}}).front();
    ASSERT_EQ(map.width(), 160);
    ASSERT_EQ(map.height(), 144);
    const at::Tensor direct = Direct(Turn(depth, turns));
    const auto values = direct.accessor<float, 4>();
    const Image<float> turned = Turn(map, turns);  // as the network saw the frame
    double least = 1, most = 0;
    for (int v = 0; v < turned.height(); ++v) {
      for (int u = 0; u < turned.width(); ++u) {
        ASSERT_NEAR(turned(u, v), values[0][0][v / 16][u / 16], 1e-5) << turns;
        least = std::min<double>(least, turned(u, v));
        most = std::max<double>(most, turned(u, v));
      }
    }
    EXPECT_GT(most - least, 1e-3);  // a constant map would pass every turn
  }
}

TEST_F(AttentionTest, ComesBackAtTheSizeOfAFrameThatIsResampled) {
  const Intrinsics k = Kinect();  // twice the focal length that the network knows
  const DepthImage depth = RandomDepth(k.width, k.height);
  const Image<float> map = AttentionMaps(Save(true), {{&depth, &k, 0}}).front();
  ASSERT_EQ(map.width(), k.width);
  ASSERT_EQ(map.height(), k.height);
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u)
      ASSERT_EQ(map(u, v), map(u / 32 * 32, v / 32 * 32)) << u << " " << v;
  }
}

TEST_F(AttentionTest, IsEmptyWithoutAttention) {
  const Intrinsics k = Kinect().Resized(160, 144);
  const DepthImage depth = RandomDepth(160, 144);
  const auto maps = AttentionMaps(Save(false), {{&depth, &k, 0}, {&depth, &k, 1}});
  ASSERT_EQ(maps.size(), 2u);
  EXPECT_TRUE(maps[0].empty());
  EXPECT_TRUE(maps[1].empty());
}

}  // namespace
}  // namespace volalign::attention_test

#include "infer/segment/load.h"

#include <ATen/Parallel.h>
#include <ATen/ops/from_blob.h>
#include <ATen/ops/rand.h>
#include <c10/core/GradMode.h>
#include <gtest/gtest.h>

#include "core/base/random.h"
#include "core/nn/checkpoint.h"
#include "core/nn/network.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::load_test {
namespace {

using namespace testing_infer;

class NetworkSegmenterTest : public ::testing::Test {
 protected:
  void SetUp() override {
    meta_.network.base_channels = 4;
    meta_.structure = PaperStructure();
    meta_.focal_px = {117, 127};
    meta_.image_sizes = {{160, 144}};
    net_ = StructureNet(meta_.network);
    net_->eval();
    SaveCheckpoint(folder_ / "model.safetensors", net_, meta_, false);
  }

  static DepthImage RandomDepth(int width, int height) {
    RandomStream random(1, 0, "segmenter_test");
    DepthImage depth(width, height);
    for (float& z : depth) z = static_cast<float>(random.Uniform(1, 4));
    return depth;
  }

  /// What the network takes for an image.
  at::Tensor Encoded(const DepthImage& depth) const {
    return EncodeDepth(at::from_blob(const_cast<float*>(depth.data()),
                                     {1, 1, depth.height(), depth.width()}, at::kFloat),
                       meta_.network.input);
  }
  /// The network's answer for an image as it stands.
  SegmentationResult Direct(const DepthImage& depth) {
    const c10::NoGradGuard no_grad;
    const at::Tensor p = net_->forward(Encoded(depth)).exp();
    SegmentationResult result{LabelImage(depth.width(), depth.height()),
                              Image<float>(depth.width(), depth.height())};
    const auto values = p.accessor<float, 4>();
    for (const auto [u, v] : Pixels(depth)) {
      for (int k = 0; k < meta_.network.num_classes; ++k) {
        if (values[0][k][v][u] > result.confidence(u, v)) {
          result.confidence(u, v) = values[0][k][v][u];
          result.labels(u, v) = static_cast<std::uint8_t>(k);
        }
      }
    }
    return result;
  }

  TempFolder folder_;
  StructureNet net_{nullptr};
  CheckpointMeta meta_;
};

TEST_F(NetworkSegmenterTest, IsTheNetworkOnFramesItKnows) {
  const auto segmenter = LoadNetworkSegmenter(folder_ / "model.safetensors");
  const DepthImage depth = RandomDepth(160, 144);
  const SegmentationResult result = segmenter->Segment(depth, Kinect().Resized(160, 144), 0);
  const SegmentationResult direct = Direct(depth);
  int different = 0;
  for (const auto [u, v] : Pixels(depth)) {
    ASSERT_NEAR(result.confidence(u, v), direct.confidence(u, v), 1e-4);
    different += result.labels(u, v) != direct.labels(u, v);
  }
  EXPECT_LE(different, 20) << "where two classes are as likely under float rounding";
  EXPECT_EQ(segmenter->structure().Hash(), PaperStructure().Hash());
  EXPECT_EQ(segmenter->sha256().size(), 64u);
}

// The number of threads is the program's to set, and holds for all of its networks.
TEST_F(NetworkSegmenterTest, LeavesLibTorchsThreadsAlone) {
  const int before = at::get_num_threads();
  for (const int threads : {1, 3}) {
    at::set_num_threads(threads);
    LoadNetworkSegmenter(folder_ / "model.safetensors")
        ->Segment(RandomDepth(160, 144), Kinect().Resized(160, 144), 0);
    EXPECT_EQ(at::get_num_threads(), threads);
  }
  at::set_num_threads(before);
}

TEST_F(NetworkSegmenterTest, RejectsAnotherStructure) {
  const Structure one = Structure::FromBoxes(
      "one", {Box::FromMinMax("box", Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones())});
  ExpectError<DataError>([&] { LoadNetworkSegmenter(folder_ / "model.safetensors", &one); });
}

}  // namespace
}  // namespace volalign::load_test

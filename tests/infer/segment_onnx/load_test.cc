#include "infer/segment_onnx/load.h"

#include <ATen/ops/from_blob.h>
#include <c10/core/GradMode.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "core/nn/checkpoint.h"
#include "core/nn/export_onnx.h"
#include "core/nn/network.h"
#include "infer/segment/load.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::load_test {
namespace {

using namespace testing_infer;

class OnnxSegmenterTest : public ::testing::Test {
 protected:
  /// A network of random weights as a checkpoint and as ONNX, in float16 both.
  void Write(Normalization normalization, InputEncoding input, bool attention) {
    meta_.network.base_channels = 4;
    meta_.network.residual_blocks = 1;
    meta_.network.normalization = normalization;
    meta_.network.input = input;
    meta_.network.attention = attention;
    meta_.structure = PaperStructure();
    meta_.focal_px = {117, 127};
    meta_.image_sizes = {{160, 144}};
    StructureNet net(meta_.network);
    const c10::NoGradGuard no_grad;
    for (at::Tensor& b : net->buffers()) b.uniform_(0.5, 1.5);
    SaveCheckpoint(folder_ / "model.safetensors", net, meta_, true);
    ExportOnnx(folder_ / "model.safetensors", folder_ / "model.onnx", true);
  }

  static DepthImage RandomDepth(int width, int height) {
    RandomStream random(1, 0, "onnx_load_test");
    DepthImage depth(width, height);
    for (float& z : depth)
      z = random.Uniform(0, 1) < 0.1 ? 0.0f : static_cast<float>(random.Uniform(1, 8));
    return depth;
  }

  static void ExpectEqual(const SegmentationResult& a, const SegmentationResult& b,
                          const std::string& where) {
    ASSERT_EQ(a.labels.width(), b.labels.width()) << where;
    ASSERT_EQ(a.labels.height(), b.labels.height()) << where;
    double largest = 0;
    std::size_t different = 0;
    for (std::size_t i = 0; i < a.labels.size(); ++i) {
      largest = std::max<double>(largest, std::abs(a.confidence[i] - b.confidence[i]));
      different += a.labels[i] != b.labels[i];
    }
    // Group normalisation divides by what is left of sums that were taken in another order.
    EXPECT_TRUE(largest < 1e-3) << where << ": " << largest;
    // Two classes may be as likely under float rounding.
    EXPECT_LE(different, a.labels.size() / 1000) << where;
  }

  TempFolder folder_;
  CheckpointMeta meta_;
};

TEST_F(OnnxSegmenterTest, LabelsAsTheNetworkInLibTorch) {
  for (const Normalization normalization : AllOf(Normalization())) {
    for (const InputEncoding input : AllOf(InputEncoding())) {
      Write(normalization, input, input == InputEncoding::kDepthMask);
      const auto theirs = LoadNetworkSegmenter(folder_ / "model.safetensors");
      const auto ours = LoadOnnxSegmenter(folder_ / "model.onnx");
      // More sizes than networks are kept of, odd ones among them, in both orientations.
      std::vector<DepthImage> depths;
      std::vector<Intrinsics> intrinsics;
      for (const int width : {160, 161, 97}) {
        Intrinsics k = Kinect().Resized(160, 144);
        k.width = width;
        k.height = 304 - width;
        depths.push_back(RandomDepth(k.width, k.height));
        intrinsics.push_back(k);
      }
      std::vector<SegmentationRequest> requests;
      for (const int turn : {0, 3}) {
        for (std::size_t i = 0; i < depths.size(); ++i)
          requests.push_back({&depths[i], &intrinsics[i], turn});
      }
      const std::vector<SegmentationResult> expected = theirs->Segment(requests);
      const std::vector<SegmentationResult> found = ours->Segment(requests);
      ASSERT_EQ(found.size(), expected.size());
      for (std::size_t i = 0; i < found.size(); ++i)
        ExpectEqual(
            found[i], expected[i],
            std::string(ToString(normalization)) + " " + ToString(input) + " " + std::to_string(i));
    }
  }
}

TEST_F(OnnxSegmenterTest, KnowsItsNetwork) {
  Write(Normalization::kBatch, InputEncoding::kDepth, true);
  const auto segmenter = LoadOnnxSegmenter(folder_ / "model.onnx");
  EXPECT_EQ(segmenter->structure().Hash(), PaperStructure().Hash());
  EXPECT_EQ(segmenter->file(), (folder_ / "model.onnx").string());
  EXPECT_EQ(segmenter->sha256().size(), 64u);
  const Structure one = Structure::FromBoxes(
      "one", {Box::FromMinMax("box", Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones())});
  ExpectError<DataError>([&] { LoadOnnxSegmenter(folder_ / "model.onnx", &one); });
}

TEST_F(OnnxSegmenterTest, SaysWhatIsWrongWithAFile) {
  ExpectError<IoError>([&] { LoadOnnxSegmenter(folder_ / "missing.onnx"); }, {"missing.onnx"});
  ExpectError<DataError>([&] { LoadOnnxSegmenter(folder_.Write("text.onnx", "no network")); },
                         {"text.onnx"});
}

TEST(EncodeDepth, IsThatOfTheNetworkInLibTorch) {
  DepthImage depth(3, 2);
  const std::vector<float> values = {0, 0.3f, 2, 5.9999f, 6, 16};
  std::copy(values.begin(), values.end(), depth.begin());
  const at::Tensor tensor = at::from_blob(depth.data(), {1, 1, 2, 3}, at::kFloat);
  for (const InputEncoding input : AllOf(InputEncoding())) {
    const std::vector<float> ours = EncodeDepth(depth, input);
    const at::Tensor theirs = EncodeDepth(tensor, input).contiguous();
    ASSERT_EQ(ours.size(), static_cast<std::size_t>(theirs.numel()));
    for (std::size_t i = 0; i < ours.size(); ++i)
      EXPECT_EQ(ours[i], theirs.data_ptr<float>()[i]) << ToString(input) << " " << i;
  }
}

}  // namespace
}  // namespace volalign::load_test

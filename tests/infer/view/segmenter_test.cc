#include "infer/view/segmenter.h"

#include <ATen/ops/from_blob.h>
#include <ATen/ops/rand.h>
#include <c10/core/GradMode.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/checkpoint.h"
#include "core/error.h"
#include "core/random.h"
#include "tests/core/expect_error.h"
#include "tests/core/temp_folder.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::Kinect;
using testing_infer::PaperStructure;

TEST(NetworkFrame, BringsTheFocalLengthIntoTheTrainedRange) {
  struct Case {
    double focal;
    int width, height;
    double scale;
    int out_width, out_height;
  };
  // Azure Kinect and D415 at full size, a network-sized frame, one just beyond the range, and one
  // of odd ratio.
  for (const Case& c : {Case{252.2, 320, 288, 2, 160, 144}, Case{235.9, 320, 180, 2, 160, 90},
                        Case{126.1, 160, 144, 1, 160, 144}, Case{127.5, 160, 144, 1, 160, 144},
                        Case{943.6, 1280, 720, 8, 160, 90}, Case{63, 80, 72, 0.5, 160, 144}}) {
    Intrinsics k;
    k.width = c.width;
    k.height = c.height;
    k.fx = k.fy = c.focal;
    const NetworkFrame frame = PlanNetworkFrame(k, {117.0, 126.5});
    EXPECT_NEAR(frame.scale, c.scale, 0.05 * c.scale) << c.focal;
    EXPECT_NEAR(frame.width, c.out_width, 0.05 * c.out_width);
    EXPECT_NEAR(frame.height, c.out_height, 0.05 * c.out_height);
    EXPECT_GE(c.focal / frame.scale, 117.0 / 1.02);
    EXPECT_LE(c.focal / frame.scale, 126.5 * 1.02);
  }
  Intrinsics tiny;
  tiny.width = tiny.height = 20;
  tiny.fx = tiny.fy = 252;
  ExpectError<DataError>([&] { PlanNetworkFrame(tiny, {117, 126}); }, {"20x20", "16 px"});
}

TEST(NetworkFrame, ResamplingInventsNoDepth) {
  DepthImage depth(320, 288);
  for (std::size_t i = 0; i < depth.size(); ++i) depth[i] = static_cast<float>(i + 1);
  for (const double scale : {2.0, 2.37, 0.5}) {
    const NetworkFrame frame{static_cast<int>(320 / scale), static_cast<int>(288 / scale), scale};
    const DepthImage small = ResampleDepth(depth, frame);
    for (int v = 0; v < small.height(); ++v) {
      for (int u = 0; u < small.width(); ++u) {
        const int i = static_cast<int>(small(u, v)) - 1;
        ASSERT_EQ(static_cast<float>(i + 1), small(u, v)) << "not a value of the frame";
        // Brute force: the frame pixel whose centre is nearest, in the coordinates of design
        // section 1.
        EXPECT_LE(std::abs(i % 320 - ((u + .5) * scale - .5)), 0.5 + 1e-9) << scale;
        EXPECT_LE(std::abs(i / 320 - ((v + .5) * scale - .5)), 0.5 + 1e-9) << scale;
      }
    }
  }
}

TEST(NetworkFrame, LabelsComeBackToTheSurfaceThatTheyMark) {
  // An edge at column 5: the half-size frame samples odd columns, so that column 4's nearest sample
  // is across it.
  DepthImage depth(12, 8, 3.0f);
  for (int v = 0; v < 8; ++v) {
    for (int u = 0; u < 5; ++u) depth(u, v) = 2.0f;
  }
  depth(1, 1) = 0;
  const NetworkFrame frame{6, 4, 2.0};
  const DepthImage small = ResampleDepth(depth, frame);
  LabelImage labels(6, 4);
  Image<float> confidence(6, 4);
  for (int v = 0; v < 4; ++v) {
    for (int u = 0; u < 6; ++u) {
      labels(u, v) = small(u, v) == 2.0f ? 7 : 0;
      confidence(u, v) = labels(u, v) ? 0.75f : 0.5f;
    }
  }
  const SegmentationResult result = RestoreSegmentation(depth, small, labels, confidence, frame);
  for (int v = 0; v < 8; ++v) {
    for (int u = 0; u < 12; ++u) {
      const bool hole = u == 1 && v == 1;
      EXPECT_EQ(result.labels(u, v), u < 5 && !hole ? 7 : 0) << u << " " << v;
      EXPECT_EQ(result.confidence(u, v), hole ? 0.0f : u < 5 ? 0.75f : 0.5f) << u << " " << v;
    }
  }
}

class NetworkSegmenterTest : public ::testing::Test {
 protected:
  void SetUp() override {
    StructureNetOptions options;
    options.base_channels = 4;
    net_ = StructureNet(options);
    net_->eval();
    meta_.network = options;
    meta_.structure = PaperStructure();
    meta_.focal_px = {117, 127};
    meta_.image_sizes = {{160, 144}};
    SaveCheckpoint(folder_ / "model.pt", net_, meta_, false);
  }

  static DepthImage RandomDepth(int width, int height) {
    RandomStream random(1, 0, "segmenter_test");
    DepthImage depth(width, height);
    for (float& z : depth) z = static_cast<float>(random.Uniform(1, 4));
    return depth;
  }

  /// The network's answer for an image as it stands.
  SegmentationResult Direct(const DepthImage& depth) {
    const c10::NoGradGuard no_grad;
    const at::Tensor input = at::from_blob(const_cast<float*>(depth.data()),
                                           {1, 1, depth.height(), depth.width()}, at::kFloat);
    const at::Tensor p = net_->forward(EncodeDepth(input, meta_.network.input)).exp();
    SegmentationResult result{LabelImage(depth.width(), depth.height()),
                              Image<float>(depth.width(), depth.height())};
    const auto values = p.accessor<float, 4>();
    for (int v = 0; v < depth.height(); ++v) {
      for (int u = 0; u < depth.width(); ++u) {
        for (int k = 0; k < meta_.network.num_classes; ++k) {
          if (values[0][k][v][u] > result.confidence(u, v)) {
            result.confidence(u, v) = values[0][k][v][u];
            result.labels(u, v) = static_cast<std::uint8_t>(k);
          }
        }
      }
    }
    return result;
  }

  static double LargestDifference(const Image<float>& a, const Image<float>& b) {
    double largest = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
      largest = std::max<double>(largest, std::abs(a[i] - b[i]));
    return largest;
  }

  TempFolder folder_;
  StructureNet net_{nullptr};
  CheckpointMeta meta_;
};

TEST_F(NetworkSegmenterTest, IsTheNetworkOnFramesItKnows) {
  const auto segmenter = LoadNetworkSegmenter(folder_ / "model.pt");
  Intrinsics k = Kinect().Resized(160, 144);
  const DepthImage depth = RandomDepth(160, 144);
  const SegmentationResult result = segmenter->Segment(depth, k, 0);
  const SegmentationResult direct = Direct(depth);
  EXPECT_LT(LargestDifference(result.confidence, direct.confidence), 1e-4);
  int different = 0;
  for (std::size_t i = 0; i < depth.size(); ++i) different += result.labels[i] != direct.labels[i];
  EXPECT_LE(different, 20);  // ties under float rounding
  EXPECT_EQ(segmenter->structure().Hash(), PaperStructure().Hash());
  EXPECT_EQ(segmenter->sha256().size(), 64u);
}

TEST_F(NetworkSegmenterTest, TurnsForthAndBack) {
  const auto segmenter = LoadNetworkSegmenter(folder_ / "model.pt");
  const Intrinsics k = Kinect().Resized(160, 144);
  const DepthImage depth = RandomDepth(160, 144);
  for (int turns = 0; turns < 4; ++turns) {
    const SegmentationResult result = segmenter->Segment(depth, k, turns);
    const SegmentationResult direct = Direct(Turn(depth, turns));
    EXPECT_LT(LargestDifference(result.confidence, Turn(direct.confidence, -turns)), 1e-4) << turns;
  }
}

TEST_F(NetworkSegmenterTest, BatchesFramesOfMixedSizes) {
  const auto segmenter = LoadNetworkSegmenter(folder_ / "model.pt");
  const Intrinsics full = Kinect();
  Intrinsics wide = full;
  wide.width = 320;
  wide.height = 180;
  const DepthImage a = RandomDepth(320, 288), b = RandomDepth(320, 180);
  const std::vector<SegmentationResult> together =
      segmenter->Segment({{&a, &full, 0}, {&b, &wide, 0}, {&a, &full, 1}, {&b, &wide, 2}});
  ASSERT_EQ(together.size(), 4u);
  const SegmentationResult alone[] = {
      segmenter->Segment(a, full, 0), segmenter->Segment(b, wide, 0),
      segmenter->Segment(a, full, 1), segmenter->Segment(b, wide, 2)};
  for (std::size_t i = 0; i < 4; ++i) {
    ASSERT_EQ(together[i].labels.width(), i % 2 ? wide.width : full.width);
    ASSERT_EQ(together[i].labels.height(), i % 2 ? wide.height : full.height);
    EXPECT_LT(LargestDifference(together[i].confidence, alone[i].confidence), 1e-4) << i;
  }
}

TEST_F(NetworkSegmenterTest, RejectsAnotherStructure) {
  const Structure one = Structure::FromBoxes(
      "one", {Box::FromMinMax("box", Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones())});
  ExpectError<DataError>([&] { LoadNetworkSegmenter(folder_ / "model.pt", &one); });
}

}  // namespace
}  // namespace volalign

#include "infer/view/network_segmenter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "infer/view/network_frame.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::network_segmenter_test {
namespace {

using namespace testing_infer;

/// Depth in centimetres is the label, the column of the network's frame the confidence.
class Ruler : public NetworkSegmenter {
 public:
  Ruler() : NetworkSegmenter({PaperStructure(), {117, 127}, "ruler", "0", ""}) {}

  std::vector<std::size_t> batches;

 private:
  std::vector<SegmentationResult> Forward(const std::vector<const DepthImage*>& depths) override {
    batches.push_back(depths.size());
    std::vector<SegmentationResult> results;
    for (const DepthImage* depth : depths) {
      EXPECT_EQ(depth->size(), depths.front()->size());
      SegmentationResult result{LabelImage(depth->width(), depth->height()),
                                Image<float>(depth->width(), depth->height())};
      for (const auto [u, v] : Pixels(*depth)) {
        result.labels(u, v) = static_cast<std::uint8_t>(std::lround(100 * (*depth)(u, v)));
        result.confidence(u, v) = static_cast<float>(u);
      }
      results.push_back(std::move(result));
    }
    return results;
  }
};

TEST(NetworkSegmenter, BringsFramesThereAndLabelsBack) {
  Ruler ruler;
  const Intrinsics full = Kinect(), small = Kinect().Resized(160, 144);
  DepthImage large_depth(320, 288, 1.0f), small_depth(160, 144, 2.0f);
  large_depth(10, 20) = 0;
  std::vector<SegmentationRequest> requests(10, {&small_depth, &small, 0});
  requests.push_back({&large_depth, &full, 0});  // of the small ones' size for the network
  requests.push_back({&small_depth, &small, 1});
  const std::vector<SegmentationResult> results = ruler.Segment(requests);
  ASSERT_EQ(results.size(), 12u);
  // Eleven frames of one size, in batches of eight, and one that is turned.
  EXPECT_EQ(ruler.batches, (std::vector<std::size_t>{1, 8, 3}));
  EXPECT_EQ(results[9].labels, LabelImage(160, 144, 200));
  EXPECT_EQ(results[9].confidence(7, 3), 7);
  EXPECT_EQ(results[10].labels(11, 20), 100);
  EXPECT_EQ(results[10].labels(10, 20), 0);  // no depth, no label
  EXPECT_EQ(results[10].confidence(319, 0), 159);
  // Turned clockwise, the frame's lowest row is the first column.
  EXPECT_EQ(results[11].confidence(5, 143), 0);
  EXPECT_EQ(results[11].confidence(5, 0), 143);
  EXPECT_EQ(ruler.Segment(small_depth, small, 2).confidence(5, 0), 154);
  EXPECT_EQ(ruler.Segment(small_depth, small, 3).confidence(5, 143), 143);
  EXPECT_EQ(ruler.file(), "ruler");
  EXPECT_EQ(ruler.structure().Hash(), PaperStructure().Hash());
}

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
    const NetworkFrame frame =
        PlanNetworkFrame({c.width, c.height, c.focal, c.focal, 0, 0, {}}, {117.0, 126.5});
    EXPECT_NEAR(frame.scale, c.scale, 0.05 * c.scale) << c.focal;
    EXPECT_NEAR(frame.width, c.out_width, 0.05 * c.out_width);
    EXPECT_NEAR(frame.height, c.out_height, 0.05 * c.out_height);
    EXPECT_GE(c.focal / frame.scale, 117.0 / 1.02);
    EXPECT_LE(c.focal / frame.scale, 126.5 * 1.02);
  }
  const Intrinsics tiny{20, 20, 252, 252, 0, 0, {}};
  ExpectError<DataError>([&] { PlanNetworkFrame(tiny, {117, 126}); }, {"20x20", "16 px"});
}

TEST(NetworkFrame, ResamplingInventsNoDepth) {
  DepthImage depth(320, 288);
  for (std::size_t i = 0; i < depth.size(); ++i) depth[i] = static_cast<float>(i + 1);
  for (const double scale : {2.0, 2.37, 0.5}) {
    const NetworkFrame frame{static_cast<int>(320 / scale), static_cast<int>(288 / scale), scale};
    const DepthImage small = ResampleDepth(depth, frame);
    for (const auto [u, v] : Pixels(small)) {
      const int i = static_cast<int>(small(u, v)) - 1;
      ASSERT_EQ(static_cast<float>(i + 1), small(u, v)) << "not a value of the frame";
      // Brute force: the frame pixel whose centre is nearest; pixel centres have integer
      // coordinates.
      const int column = i % 320, row = i / 320;
      EXPECT_LE(std::abs(column - ((u + .5) * scale - .5)), 0.5 + 1e-9) << scale;
      EXPECT_LE(std::abs(row - ((v + .5) * scale - .5)), 0.5 + 1e-9) << scale;
    }
  }
}

TEST(NetworkFrame, LabelsComeBackToTheSurfaceThatTheyMark) {
  // An edge at column 5: the half-size frame samples odd columns, so that column 4's nearest sample
  // is across it.
  DepthImage depth(12, 8, 3.0f);
  for (const auto [u, v] : Pixels(5, 8)) depth(u, v) = 2.0f;
  depth(1, 1) = 0;
  const NetworkFrame frame{6, 4, 2.0};
  const DepthImage small = ResampleDepth(depth, frame);
  LabelImage labels(6, 4);
  Image<float> confidence(6, 4);
  for (const auto [u, v] : Pixels(6, 4)) {
    labels(u, v) = small(u, v) == 2.0f ? 7 : 0;
    confidence(u, v) = labels(u, v) ? 0.75f : 0.5f;
  }
  const SegmentationResult result = RestoreSegmentation(depth, small, labels, confidence, frame);
  for (const auto [u, v] : Pixels(12, 8)) {
    const bool hole = u == 1 && v == 1;
    EXPECT_EQ(result.labels(u, v), u < 5 && !hole ? 7 : 0) << u << " " << v;
    EXPECT_EQ(result.confidence(u, v), hole ? 0.0f : u < 5 ? 0.75f : 0.5f) << u << " " << v;
  }
}

}  // namespace
}  // namespace volalign::network_segmenter_test

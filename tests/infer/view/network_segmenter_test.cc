#include "infer/view/network_segmenter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "tests/infer/view/synthetic.h"

namespace volalign::network_segmenter_test {
namespace {

using testing_infer::Kinect;
using testing_infer::PaperStructure;

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
      for (int v = 0; v < depth->height(); ++v) {
        for (int u = 0; u < depth->width(); ++u) {
          result.labels(u, v) = static_cast<std::uint8_t>(std::lround(100 * (*depth)(u, v)));
          result.confidence(u, v) = static_cast<float>(u);
        }
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
  EXPECT_EQ(ruler.file(), "ruler");
  EXPECT_EQ(ruler.structure().Hash(), PaperStructure().Hash());
}

}  // namespace
}  // namespace volalign::network_segmenter_test

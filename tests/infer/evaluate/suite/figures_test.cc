#include "infer/evaluate/suite/figures.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::figures_test {
namespace {

using testing_infer::PaperStructure;

/// Counts of pixels that are more blue than red, and more red than blue, in a part of the columns.
struct Counts {
  int blue = 0, red = 0;
};
Counts Count(const RgbImage& picture, int first, int end) {
  Counts counts;
  for (int v = 0; v < picture.height(); ++v) {
    for (int u = first; u < end; ++u) {
      const Rgb colour = picture(u, v);
      if (colour.b > colour.r) ++counts.blue;
      if (colour.r > colour.b) ++counts.red;
    }
  }
  return counts;
}

TEST(Figures, PointsAreVioletOnTheSurfaceAndYellowFarOff) {
  const Structure structure = PaperStructure();
  ErrorCloud cloud;
  // Seen from +x, -z is on the right. The second point is hidden by the first.
  cloud.points = {{0.6, 0, 0}, {0.3, 0, 0}, {0.3, 0, -0.5}};
  cloud.distances = {0, 0.2, 0.2};
  const RgbImage picture = DrawCloud(cloud, structure, 0);
  const int middle = picture.width() / 2;
  const Counts left = Count(picture, 0, middle + 20),
               right = Count(picture, middle + 20, picture.width());
  EXPECT_EQ(left.blue, 9);
  EXPECT_EQ(left.red, 0);
  EXPECT_EQ(right.blue, 0);
  EXPECT_EQ(right.red, 9);
  // From behind, the hidden one is in front.
  const RgbImage behind = DrawCloud(cloud, structure, 180);
  EXPECT_EQ(Count(behind, 0, behind.width()).blue, 0);
}

TEST(Figures, AttentionIsVioletAtZeroAndYellowAtOne) {
  DepthImage depth(4, 3, 2.0F);
  depth(3, 2) = 0;
  Image<float> attention(4, 3, 0.0F);
  attention(1, 1) = attention(3, 2) = 1;
  const RgbImage picture = DrawAttention(depth, attention);
  EXPECT_EQ(Count(picture, 0, 4).blue, 10);
  EXPECT_EQ(Count(picture, 1, 2).red, 1);
  EXPECT_EQ(Count(picture, 3, 4).red, 1);
  EXPECT_LT(picture(3, 2).r, picture(1, 1).r);  // without depth, and dark
  ExpectError<Error>([&] { DrawAttention(depth, Image<float>(3, 4)); }, {"sizes"});
}

TEST(Figures, CloudsHaveTheLabelledPixels) {
  const Structure structure = PaperStructure();
  const Pose pose = testing_infer::RingPose(20);
  const testing_infer::SyntheticView seen =
      testing_infer::Render(structure, testing_infer::Kinect(), pose);
  ErrorCloud cloud;
  AddToCloud(MakeSensorView(seen.depth, testing_infer::Kinect()), seen.labels, structure, pose,
             &cloud);
  std::size_t labelled = 0;
  for (const std::uint8_t label : seen.labels) labelled += label > 0 ? 1 : 0;
  ASSERT_EQ(cloud.points.size(), labelled);
  for (const double distance : cloud.distances) EXPECT_LT(distance, 1e-4);
}

}  // namespace
}  // namespace volalign::figures_test

#include "infer/report/html_report/encode.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "core/base/file_util.h"

namespace volalign::encode_test {
namespace {

TEST(EncodeCloud, HoldsHalfMillimetresLittleEndian) {
  AlignedPoint point;
  point.p = {1.0f, -0.0005f, 100.0f};  // 2000, -1, beyond 16 bits
  point.label = 200;
  point.side_residual = -0.01f;  // -40
  AlignedPoint background;
  const EncodedCloud cloud = EncodeCloud({point, background});
  EXPECT_EQ(cloud.count, 2u);
  EXPECT_EQ(cloud.positions, Base64(std::string("\xd0\x07\xff\xff\xff\x7f\0\0\0\0\0\0", 12)));
  EXPECT_EQ(cloud.labels, Base64(std::string("\xc8\0", 2)));
  EXPECT_EQ(cloud.residuals, Base64(std::string("\xd8\x80", 2)));
}

TEST(ThinCloud, PrefersLabelledPointsAndTakesEvenly) {
  std::vector<AlignedPoint> points(10000);
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i].p.x() = static_cast<float>(i);
    points[i].label = i < 2000 ? 1 : 0;
  }
  const auto labelled = [](const std::vector<AlignedPoint>& of) {
    return std::count_if(of.begin(), of.end(), [](const auto& p) { return p.label > 0; });
  };
  EXPECT_EQ(ThinCloud(points, 10000).size(), 10000u);
  const std::vector<AlignedPoint> thinned = ThinCloud(points, 1000);
  ASSERT_EQ(thinned.size(), 1000u);
  EXPECT_EQ(labelled(thinned), 600);
  for (std::size_t i = 1; i < 600; ++i) {
    EXPECT_GT(thinned[i].p.x(), thinned[i - 1].p.x());  // each once
    EXPECT_LE(thinned[i].p.x() - thinned[i - 1].p.x(), 7);
  }
  // All labelled points where they are few; more of them where there is little else.
  EXPECT_EQ(labelled(ThinCloud(points, 5000)), 2000);
  EXPECT_EQ(ThinCloud(points, 5000).size(), 5000u);
  points.resize(2100);
  EXPECT_EQ(labelled(ThinCloud(points, 1000)), 900);
}

}  // namespace
}  // namespace volalign::encode_test

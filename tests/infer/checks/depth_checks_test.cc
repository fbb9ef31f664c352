#include "infer/checks/depth_checks.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/core/base/expect_error.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::depth_checks_test {
namespace {

/// Every pixel at its own depth, from `nearest` to `farthest`.
SensorFrame Ramp(const std::string& name, float nearest, float farthest) {
  SensorFrame frame;
  frame.name = name;
  frame.intrinsics = testing_infer::Coarse();
  frame.depth = DepthImage(20, 10);
  for (std::size_t i = 0; i < frame.depth.size(); ++i)
    frame.depth[i] = nearest + (farthest - nearest) * static_cast<float>(i) / 199;
  return frame;
}

std::vector<DepthFinding> Check(const std::vector<SensorFrame>& frames) {
  std::vector<SensorView> views;
  for (const SensorFrame& frame : frames) views.push_back(MakeSensorView(frame, frame.intrinsics));
  return CheckDepths(frames, views);
}

TEST(DepthChecks, CountsPixelsWithDepth) {
  SensorFrame frame = Ramp("A", 1, 4);
  for (std::size_t i = 0; i < frame.depth.size(); ++i) frame.depth[i] *= i < 2;
  EXPECT_FALSE(Check({frame}).front().failure.has_value());  // 2 of 200: 1 %
  frame.depth[0] = 0;
  const DepthFinding finding = Check({frame}).front();
  ASSERT_TRUE(finding.failure.has_value());
  EXPECT_EQ(finding.failure->code, SensorCode::kNoDepth);
  EXPECT_TRUE(Has(finding.failure->reason, "0.5 %"));
}

TEST(DepthChecks, GivesTheRangeOfAWrongUnit) {
  struct Case {
    float factor;
    const char* words;
  };
  // A room of 1 to 4 m, read in another unit.
  for (const Case& c :
       {Case{1000, "313 to 5015 times too large"}, Case{10, "3.1 to 50 times too large"},
        Case{0.1f, "2.0 to 32 times too small"}, Case{0.001f, "199 to 3190 times too small"}}) {
    const DepthFinding finding = Check({Ramp("A", c.factor, 4 * c.factor)}).front();
    ASSERT_TRUE(finding.failure.has_value()) << c.factor;
    EXPECT_EQ(finding.failure->code, SensorCode::kWrongUnits);
    EXPECT_TRUE(Has(finding.failure->reason, c.words));
  }
}

/// 400 of 1,000 pixels have this value, the others those of a room.
DepthImage WithStandIn(float value) {
  DepthImage depth(100, 10);
  for (std::size_t i = 0; i < depth.size(); ++i)
    depth[i] = i % 5 < 2 ? value : 1 + 0.003f * static_cast<float>(i);
  return depth;
}

TEST(DropStandIns, OfAnyValueBeyondARoom) {
  for (const float value : {65.535f, 13.107f, 0.001f, 20.0f}) {
    DepthImage depth = WithStandIn(value);
    const DepthImage before = depth;
    DropStandIns(&depth);
    for (std::size_t i = 0; i < depth.size(); ++i)
      ASSERT_EQ(depth[i], i % 5 < 2 ? 0 : before[i]) << value;
  }
}

TEST(DropStandIns, NotOfASurface) {
  // Within a room; or one of many depths of a wall in a hall, or of depths in a wrong unit.
  DepthImage wall = WithStandIn(2.5f), hall = WithStandIn(12), unit = wall;
  for (std::size_t i = 0; i < wall.size(); ++i) {
    if (i % 5 == 2) hall[i] = 12.1f;
    unit[i] = 200 + static_cast<float>(i % 10);
  }
  for (const DepthImage& before : {wall, hall, unit}) {
    DepthImage depth = before;
    DropStandIns(&depth);
    EXPECT_TRUE(depth == before);
  }
}

TEST(DepthChecks, ANearObjectInARoomIsNoWrongUnit) {
  // A tenth of the pixels beyond 0.9 m is a background.
  SensorFrame frame = Ramp("A", 0.5f, 0.6f);
  for (std::size_t i = 180; i < 200; ++i) frame.depth[i] = 3;
  EXPECT_FALSE(Check({frame}).front().failure.has_value());
}

TEST(DepthChecks, TheFirstOfTwoEqualMapsStaysAndBothNameTheOther) {
  const std::vector<DepthFinding> findings =
      Check({Ramp("A", 1, 4), Ramp("B", 1, 3), Ramp("C", 1, 4)});
  EXPECT_FALSE(findings[0].failure.has_value());
  EXPECT_EQ(findings[0].same_depth_as, "C");
  EXPECT_FALSE(findings[1].failure.has_value());
  EXPECT_EQ(findings[1].same_depth_as, "");
  ASSERT_TRUE(findings[2].failure.has_value());
  EXPECT_EQ(findings[2].failure->code, SensorCode::kDuplicateDepth);
  EXPECT_EQ(findings[2].same_depth_as, "A");
}

}  // namespace
}  // namespace volalign::depth_checks_test

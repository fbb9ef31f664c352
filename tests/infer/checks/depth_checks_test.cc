#include "infer/checks/depth_checks.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::depth_checks_test {
namespace {

Intrinsics Small() {
  Intrinsics intrinsics;
  intrinsics.width = 20;
  intrinsics.height = 10;
  intrinsics.fx = intrinsics.fy = 40;
  intrinsics.cx = 9.5;
  intrinsics.cy = 4.5;
  return intrinsics;
}

/// Every pixel at its own depth, from `nearest` to `farthest`.
SensorFrame Ramp(const std::string& name, float nearest, float farthest) {
  SensorFrame frame;
  frame.name = name;
  frame.intrinsics = Small();
  frame.depth = DepthImage(20, 10);
  for (std::size_t i = 0; i < frame.depth.size(); ++i)
    frame.depth[i] = nearest + (farthest - nearest) * static_cast<float>(i) / 199;
  return frame;
}

std::vector<DepthFinding> Check(const std::vector<SensorFrame>& frames) {
  std::vector<SensorView> views;
  for (const SensorFrame& frame : frames) views.push_back(MakeSensorView(frame, frame.intrinsics));
  return CheckDepths(frames, views, VerdictOptions());
}

TEST(DepthChecks, ARoomPasses) {
  const DepthFinding finding = Check({Ramp("A", 1, 4)}).front();
  EXPECT_FALSE(finding.failure.has_value());
  EXPECT_EQ(finding.same_depth_as, "");
}

TEST(DepthChecks, CountsPixelsWithDepth) {
  SensorFrame frame = Ramp("A", 1, 4);
  for (std::size_t i = 0; i < frame.depth.size(); ++i) frame.depth[i] *= i < 2;
  EXPECT_FALSE(Check({frame}).front().failure.has_value());  // 2 of 200: 1 %
  frame.depth[0] = 0;
  const DepthFinding finding = Check({frame}).front();
  ASSERT_TRUE(finding.failure.has_value());
  EXPECT_EQ(finding.failure->code, SensorCode::kNoDepth);
  EXPECT_NE(finding.failure->reason.find("0.5 %"), std::string::npos) << finding.failure->reason;
}

TEST(DepthChecks, NamesTheFactorOfAWrongUnit) {
  struct Case {
    float factor;
    const char* words;
  };
  // A room of 1 to 4 m, read in another unit.
  for (const Case& c : {Case{1000, "1000 times too large"}, Case{10, "10 times too large"},
                        Case{0.1f, "10 times too small"}, Case{0.001f, "1000 times too small"}}) {
    const DepthFinding finding = Check({Ramp("A", c.factor, 4 * c.factor)}).front();
    ASSERT_TRUE(finding.failure.has_value()) << c.factor;
    EXPECT_EQ(finding.failure->code, SensorCode::kWrongUnits);
    EXPECT_NE(finding.failure->reason.find(c.words), std::string::npos) << finding.failure->reason;
  }
}

TEST(RequireUnits, IsAnErrorWhereAllSensorsAgree) {
  // Millimetres, read as metres.
  std::vector<SensorFrame> frames = {Ramp("A", 1000, 4000), Ramp("B", 1500, 3000)};
  for (SensorFrame& frame : frames) frame.depth_scale = 1;
  ExpectError<DataError>([&] { RequireUnits(frames, Check(frames)); },
                         {"sensor \"A\"", "beyond 2492 m", "set depth_scale to 0.001"});
  // An empty frame says nothing about units.
  frames.push_back(Ramp("C", 0, 0));
  ExpectError<DataError>([&] { RequireUnits(frames, Check(frames)); }, {"0.001"});
  // One that is right, or wrong in another way, is a matter of single sensors.
  frames.push_back(Ramp("D", 1, 4));
  RequireUnits(frames, Check(frames));
  frames.back() = Ramp("D", 1000, 4000);
  RequireUnits(frames, Check(frames));
  // A single one may have looked at a wall before it.
  for (const std::vector<SensorFrame>& one :
       {std::vector<SensorFrame>{Ramp("C", 0, 0)}, {Ramp("A", 0.4f, 0.5f), Ramp("C", 0, 0)}}) {
    RequireUnits(one, Check(one));
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

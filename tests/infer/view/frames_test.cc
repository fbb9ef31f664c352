#include "infer/view/frames.h"

#include <gtest/gtest.h>

namespace volalign::frames_test {
namespace {

Still StillOf(const std::string& name, const std::vector<std::string>& sensors) {
  Still still;
  still.name = name;
  for (const std::string& sensor : sensors) {
    still.frames.emplace_back();
    still.frames.back().name = sensor;
  }
  return still;
}

TEST(CaptureSet, FramesOfOneNameAreOfOneSensor) {
  const CaptureSet capture(
      {StillOf("a", {"left", "right"}), StillOf("b", {"right", "top", "left"})}, Structure());
  EXPECT_EQ(capture.sensors, (std::vector<std::string>{"left", "right", "top"}));
  EXPECT_EQ(capture.sensor_of.OfStill(0), (std::vector<std::size_t>{0, 1}));
  EXPECT_EQ(capture.sensor_of.OfStill(1), (std::vector<std::size_t>{1, 2, 0}));
  const FrameId top{1, 1};
  EXPECT_EQ(capture[top].name, "top");
  EXPECT_EQ(capture.sensor_of[top], 2u);
}

TEST(PerFrame, GoesStillByStill) {
  const PerFrame<int> values({{10, 11}, {}, {20, 21, 22}});
  const std::vector<FrameId> ids = values.Ids();
  EXPECT_EQ(ids, (std::vector<FrameId>{{0, 0}, {0, 1}, {2, 0}, {2, 1}, {2, 2}}));
  for (const int threads : {1, 3}) {
    const auto doubled = MapFrames(values, threads, [&](FrameId id) { return 2 * values[id]; });
    EXPECT_EQ(doubled.stills(), 3u);
    for (const FrameId id : ids) EXPECT_EQ(doubled[id], 2 * values[id]);
  }
  EXPECT_LT(ids[1], ids[2]);
  EXPECT_FALSE(ids[2] < ids[1]);
}

}  // namespace
}  // namespace volalign::frames_test

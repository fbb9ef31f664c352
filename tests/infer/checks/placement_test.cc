#include "infer/checks/placement.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/core/base/expect_error.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/checks/seen_with_labels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::placement_test {
namespace {

using namespace testing_infer;

/// A rig with true labels on its way to LocateAlone.
struct Located {
  CalibrateOptions options;
  CaptureSet capture;
  Seen seen;

  explicit Located(const Rig& rig)
      : capture({{"", rig.frames}}, rig.structure), seen(SeenWithLabels(capture, rig.labels)) {}
  LocateOptions locate() const { return {options.refine, options.verdict, 1}; }
  std::vector<LocateResult> Alone(const std::optional<AssemblyReport>& assembly = {}) const {
    return LocateAlone(seen, {assembly}, locate()).OfCapture(0);
  }
};

/// S0 sees many sides; S1 the front of the two lowest boxes and little more, from which a pose
/// follows all the same.
Rig NarrowRig() {
  Rig rig{PaperStructure(), {}, {}};
  rig.Add("S0", RingPose(40));
  rig.Add("S1", RingPose(40, 1.2, 0.0, 90, {0, -0.55, 0}));
  return rig;
}

// What fixes a pose is how well the sensor's own position is known: the same boxes, described about
// a point 100 m beside the stack.
TEST(LocateAlone, WhatAViewFixesDoesNotDependOnTheOrigin) {
  Rig rig = NarrowRig();
  const Pose away(Eigen::Translation3d(100, 0, 0));
  rig.structure = rig.structure.Displaced(std::vector<Pose>(rig.structure.boxes().size(), away));
  for (SensorFrame& frame : rig.frames) frame.ground_truth = away * *frame.ground_truth;
  Located frames(rig);
  frames.options.verdict.max_sigma_position_m = 0.05;
  const std::vector<LocateResult> results = frames.Alone();
  for (std::size_t i = 0; i < 2; ++i) {
    const auto* placed = std::get_if<LocatedFrame>(&results[i]);
    ASSERT_NE(placed, nullptr) << std::get<Finding>(results[i]).reason;
    EXPECT_TRUE(Within(ComparePoses(placed->own_pose, *rig.frames[i].ground_truth),
                       i == 0 ? 1e-3 : 3e-3, 0.05));
  }
}

TEST(LocateAlone, AFrameWithoutSidesOrWithOneOnly) {
  Rig rig = NarrowRig();
  rig.labels[0] = LabelImage(320, 288);
  const auto front = static_cast<std::uint8_t>(LabelOf(rig.structure, "bottom/front"));
  for (std::uint8_t& label : rig.labels[1]) label = label == front ? front : 0;
  const std::vector<LocateResult> results = Located(rig).Alone();
  ASSERT_TRUE(std::holds_alternative<Finding>(results[0]));
  EXPECT_EQ(std::get<Finding>(results[0]).code, SensorCode::kNoStructure);
  ASSERT_TRUE(std::holds_alternative<Finding>(results[1]));
  EXPECT_EQ(std::get<Finding>(results[1]).code, SensorCode::kDegenerateSides);
}

// Three sides in a line, cut off by the right border of the scene as a person sees it.
TEST(LocateAlone, ACutOffStructureSaysWhereToTurn) {
  Rig rig = NarrowRig();
  rig.Add("S2", RingPose(90, 2.0, 0.3, 90, {-1.1, 0, 0}));  // from +z, +x is on the right
  Restrict(rig.structure, &rig.labels[2], [](const Side& side) {
    return side.name == "mid_bottom/right" || side.name == "mid_top/right" ||
           side.name == "bottom/right";
  });
  const LocateResult result = Located(rig).Alone()[2];
  ASSERT_TRUE(std::holds_alternative<Finding>(result));
  EXPECT_EQ(std::get<Finding>(result).code, SensorCode::kDegenerateSides);
  EXPECT_TRUE(Has(std::get<Finding>(result).hint, "border of its picture cuts the structure off"));
}

TEST(LocateAlone, NoSensorIsPlacedInAStackThatIsBuiltOtherwise) {
  const Located frames(NarrowRig());
  AssemblyReport report;
  report.arrangement.code = SensorCode::kAssemblyMirrored;
  report.arrangement.sentence = "the stack or the frames are mirrored";
  report.described_share = 0.7;
  report.share = 0.98;
  report.seen_by = {0};
  for (const LocateResult& result : frames.Alone(report)) {
    const auto* finding = std::get_if<Finding>(&result);
    ASSERT_NE(finding, nullptr);
    EXPECT_EQ(finding->code, SensorCode::kAssemblyMirrored);
    EXPECT_EQ(finding->reason,
              "the stack or the frames are mirrored: this explains 98 % of what the sensors see, "
              "and the stack as described 70 %");
    EXPECT_TRUE(Has(finding->hint, "if only the stack is mirrored", "in the pictures"));
  }
}

TEST(LocateAlone, NoSensorIsPlacedWhoseUpIsUnknown) {
  Located frames(NarrowRig());
  frames.seen.labelled[{0, 0}].up_unknown = true;
  const LocateResult result = frames.Alone()[0];
  const auto* finding = std::get_if<Finding>(&result);
  ASSERT_NE(finding, nullptr);
  EXPECT_EQ(finding->code, SensorCode::kAmbiguous);
  EXPECT_TRUE(Has(finding->reason, "Nothing shows which is right"));
  EXPECT_TRUE(Has(finding->hint, "quarter_turns"));
}

TEST(FramesToRefine, AreTheLocatedOnes) {
  Located frames(NarrowRig());
  std::vector<LocateResult> results = frames.Alone();
  SomeFrames<FrameInput> sensors = FramesToRefine(frames.seen, PerFrame<LocateResult>({results}));
  ASSERT_EQ(sensors.size(), 2u);
  EXPECT_EQ(sensors.at({0, 1}).start.matrix(),
            std::get<LocatedFrame>(results[1]).own_pose.matrix());
  results[0] = Finding{SensorCode::kNoStructure, "", ""};
  sensors = FramesToRefine(frames.seen, PerFrame<LocateResult>({results}));
  ASSERT_EQ(sensors.size(), 1u);
  const SensorPoints* points = std::get<LocatedFrame>(results[1]).points.get();
  results.clear();
  EXPECT_EQ(sensors.at({0, 1}).points.get(), points);
  EXPECT_EQ(sensors.at({0, 1}).points.use_count(), 1) << "frames own what they are solved from";
}

}  // namespace
}  // namespace volalign::placement_test

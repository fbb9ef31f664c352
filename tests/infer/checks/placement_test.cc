#include "infer/checks/placement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "infer/checks/verification.h"
#include "tests/infer/checks/seen_with_labels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::placement_test {
namespace {

using testing_infer::Rig;
using testing_infer::RingPose;

/// A rig with true labels on its way to LocateAlone.
struct Located {
  CalibrateOptions options;
  CaptureSet capture;
  Seen seen;

  explicit Located(const Rig& rig)
      : capture({{"", rig.frames}}, rig.structure),
        seen(testing_infer::SeenWithLabels(capture, rig.labels)) {}
  LocateOptions locate() const { return {options.initial, options.refine, options.verdict, 1}; }
  std::vector<LocateResult> Alone(const std::optional<AssemblyReport>& assembly = {}) const {
    return LocateAlone(seen, {assembly}, locate()).OfCapture(0);
  }
};

/// S0 sees many sides; S1 the front of the two lowest boxes and little more, from which a pose
/// follows all the same.
Rig NarrowRig() {
  Rig rig{testing_infer::PaperStructure(), {}, {}};
  rig.Add("S0", RingPose(40));
  rig.Add("S1", RingPose(40, 1.2, 0.0, 90, {0, -0.55, 0}));
  return rig;
}

TEST(LocateAlone, OwnPosesAreTheTrueOnes) {
  const Rig rig = NarrowRig();
  const std::vector<LocateResult> results = Located(rig).Alone();
  for (std::size_t i = 0; i < 2; ++i) {
    const auto* placed = std::get_if<LocatedFrame>(&results[i]);
    ASSERT_NE(placed, nullptr) << std::get<Finding>(results[i]).reason;
    const PoseError error = ComparePoses(placed->own_pose, *rig.frames[i].ground_truth);
    EXPECT_LT(error.translation_m, i == 0 ? 1e-3 : 3e-3);
    EXPECT_LT(error.rotation_deg, 0.05);
  }
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
  for (const LocateResult& result : frames.Alone()) {
    const auto* placed = std::get_if<LocatedFrame>(&result);
    EXPECT_NE(placed, nullptr) << std::get<Finding>(result).reason;
  }
}

// A board 80 cm before the sensor leaves a third of the stack's pixels free: what it hides neither
// confirms nor refutes the pose.
TEST(LocateAlone, WhatHidesTheStackDoesNotRefuteThePose) {
  Rig rig{testing_infer::PaperStructure(), {}, {}};
  rig.Add("S0", RingPose(40));
  DepthImage& depth = rig.frames[0].depth;
  LabelImage& labels = rig.labels[0];
  const auto count = [&] {
    return std::count_if(labels.begin(), labels.end(),
                         [](std::uint8_t label) { return label > 0; });
  };
  const auto all = count();
  for (int v = 0; v < depth.height() && 3 * count() > all; ++v) {
    for (int u = 0; u < depth.width(); ++u) {
      depth(u, v) = 0.8f;
      labels(u, v) = 0;
    }
  }
  const LocateResult result = Located(rig).Alone()[0];
  const auto* placed = std::get_if<LocatedFrame>(&result);
  ASSERT_NE(placed, nullptr) << std::get<Finding>(result).reason;
  EXPECT_LT(ComparePoses(placed->own_pose, *rig.frames[0].ground_truth).translation_m, 3e-3);
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
  }
}

TEST(LocateAlone, AMirroredFrameIsNotPlacedAndTheOthersAre) {
  const Located frames(NarrowRig());
  AssemblyReport report;
  report.mirrored_frames = {1};
  const std::vector<LocateResult> results = frames.Alone(report);
  EXPECT_TRUE(std::holds_alternative<LocatedFrame>(results[0]));
  ASSERT_TRUE(std::holds_alternative<Finding>(results[1]));
  EXPECT_EQ(std::get<Finding>(results[1]).code, SensorCode::kFrameMirrored);
}

TEST(LocateAlone, AFrameWithoutSidesOrWithOneOnly) {
  Rig rig = NarrowRig();
  rig.labels[0] = LabelImage(320, 288);
  const auto front =
      static_cast<std::uint8_t>(testing_infer::LabelOf(rig.structure, "bottom/front"));
  for (std::uint8_t& label : rig.labels[1]) label = label == front ? front : 0;
  const std::vector<LocateResult> results = Located(rig).Alone();
  ASSERT_TRUE(std::holds_alternative<Finding>(results[0]));
  EXPECT_EQ(std::get<Finding>(results[0]).code, SensorCode::kNoStructure);
  ASSERT_TRUE(std::holds_alternative<Finding>(results[1]));
  EXPECT_EQ(std::get<Finding>(results[1]).code, SensorCode::kDegenerateSides);
}

/// Of the labels that are seen along at least 40 pixels of the first or last row, the one that most
/// pixels have; 0: none.
int CutOff(const LabelImage& labels) {
  std::map<int, int> along_border, pixels;
  for (int u = 0; u < labels.width(); ++u) {
    for (const int v : {0, labels.height() - 1}) ++along_border[labels(u, v)];
  }
  for (const std::uint8_t label : labels) {
    if (label > 0 && along_border[label] >= 40) ++pixels[label];
  }
  const auto fewer = [](const auto& a, const auto& b) { return a.second < b.second; };
  const auto most = std::max_element(pixels.begin(), pixels.end(), fewer);
  return most == pixels.end() ? 0 : most->first;
}

TEST(LocateAlone, TheHintKnowsWhichWayTheSensorIsMounted) {
  // S0 stands well. S1, which is mounted on its side as S0 is, looks so far to the right or to the
  // left of the structure that the border of its picture cuts off the one side that is labelled.
  const double phi = 40 * M_PI / 180;
  const Eigen::Vector3d to_the_right(std::sin(phi), 0, -std::cos(phi));
  for (const double sign : {1.0, -1.0}) {
    Rig rig{testing_infer::PaperStructure(), {}, {}};
    rig.Add("S0", RingPose(40));
    int kept = 0;
    for (double aside = 0.5; kept == 0 && aside < 1.6; aside += 0.1) {
      rig.frames.resize(1);
      rig.labels.resize(1);
      rig.Add("S1", RingPose(40, 2.0, 0.0, 90, sign * aside * to_the_right));
      kept = CutOff(rig.labels[1]);
    }
    ASSERT_GT(kept, 0);
    for (std::uint8_t& label : rig.labels[1]) {
      if (label != kept) label = 0;
    }
    const std::vector<LocateResult> results = Located(rig).Alone();
    ASSERT_TRUE(std::holds_alternative<LocatedFrame>(results[0]));
    ASSERT_TRUE(std::holds_alternative<Finding>(results[1]));
    const Finding& finding = std::get<Finding>(results[1]);
    EXPECT_EQ(finding.code, SensorCode::kDegenerateSides) << finding.reason;
    const std::string there = sign > 0 ? "to the left" : "to the right";
    EXPECT_NE(finding.hint.find("turn the sensor " + there), std::string::npos) << finding.hint;
  }
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

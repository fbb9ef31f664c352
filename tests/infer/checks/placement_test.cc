#include "infer/checks/placement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "infer/calibrate.h"
#include "infer/checks/verification.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::Certain;
using testing_infer::Rig;
using testing_infer::RingPose;

/// Frames with true labels on their way to PlaceSensors.
struct Labelled {
  CalibrateOptions options;
  std::vector<SensorView> views;
  std::vector<DepthFinding> depths;
  std::vector<LabelledView> labelled;

  explicit Labelled(const Rig& rig) {
    views = MakeSensorViews(rig.frames, 1);
    depths = CheckDepths(rig.frames, views, options.verdict);
    for (std::size_t i = 0; i < rig.frames.size(); ++i) {
      LabelledView view;
      view.segmentation = Certain(rig.labels[i]);
      view.quarter_turns = 1;
      view.initial =
          EstimateInitialPose(views[i], view.segmentation, rig.structure, options.initial);
      labelled.push_back(std::move(view));
    }
  }
  PlacementOptions placement() const {
    return {options.initial, options.refine, options.verdict, options.assembly, 1};
  }
  std::vector<Placement> Place(const Rig& rig, const std::optional<AssemblyReport>& assembly) {
    return PlaceSensors(rig.frames, views, depths, labelled, assembly, GivenLenses(rig.frames),
                        rig.structure, placement());
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

TEST(PlaceSensors, OwnPosesAreTheTrueOnes) {
  const Rig rig = NarrowRig();
  const std::vector<Placement> placements = Labelled(rig).Place(rig, std::nullopt);
  for (std::size_t i = 0; i < 2; ++i) {
    const auto* placed = std::get_if<PlacedSensor>(&placements[i]);
    ASSERT_NE(placed, nullptr) << std::get<Finding>(placements[i]).reason;
    const PoseError error = ComparePoses(placed->own_pose, *rig.frames[i].ground_truth);
    EXPECT_LT(error.translation_m, i == 0 ? 1e-3 : 3e-3);
    EXPECT_LT(error.rotation_deg, 0.05);
  }
}

TEST(PlaceSensors, NoSensorIsPlacedInAStackThatIsBuiltOtherwise) {
  const Rig rig = NarrowRig();
  Labelled frames(rig);
  ASSERT_TRUE(SeesManySides(frames.labelled[0].initial.evidence, frames.options.verdict));
  frames.options.verdict.many_sides =
      1 + static_cast<int>(frames.labelled[1].initial.evidence.size());
  ASSERT_FALSE(SeesManySides(frames.labelled[1].initial.evidence, frames.options.verdict));
  AssemblyReport report;
  report.arrangement.code = SensorCode::kAssemblyMirrored;
  report.arrangement.sentence = "the stack or the frames are mirrored";
  report.described_overlap = 0.7;
  report.overlap = 0.98;
  for (const Placement& placement : frames.Place(rig, report)) {
    const auto* finding = std::get_if<Finding>(&placement);
    ASSERT_NE(finding, nullptr);
    EXPECT_EQ(finding->code, SensorCode::kAssemblyMirrored);
    EXPECT_EQ(finding->reason,
              "the stack or the frames are mirrored: that explains 98 % of what the sensors see, "
              "the stack as "
              "described 70 %");
  }
}

TEST(PlaceSensors, AFrameWithoutSidesOrWithOneOnly) {
  Rig rig = NarrowRig();
  rig.labels[0] = LabelImage(320, 288);
  const auto front =
      static_cast<std::uint8_t>(testing_infer::LabelOf(rig.structure, "bottom/front"));
  for (std::uint8_t& label : rig.labels[1]) label = label == front ? front : 0;
  const std::vector<Placement> placements = Labelled(rig).Place(rig, std::nullopt);
  ASSERT_TRUE(std::holds_alternative<Finding>(placements[0]));
  EXPECT_EQ(std::get<Finding>(placements[0]).code, SensorCode::kNoStructure);
  ASSERT_TRUE(std::holds_alternative<Finding>(placements[1]));
  EXPECT_EQ(std::get<Finding>(placements[1]).code, SensorCode::kDegenerateSides);
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

TEST(PlaceSensors, TheHintKnowsWhichWayTheSensorIsMounted) {
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
    const std::vector<Placement> placements = Labelled(rig).Place(rig, std::nullopt);
    ASSERT_TRUE(std::holds_alternative<PlacedSensor>(placements[0]));
    ASSERT_TRUE(std::holds_alternative<Finding>(placements[1]));
    const Finding& finding = std::get<Finding>(placements[1]);
    EXPECT_EQ(finding.code, SensorCode::kDegenerateSides) << finding.reason;
    const std::string there = sign > 0 ? "to the left" : "to the right";
    EXPECT_NE(finding.hint.find("turn the sensor " + there), std::string::npos) << finding.hint;
  }
}

TEST(InspectStack, NamesMirroredFramesByTheirPlaceInTheCapture) {
  Rig rig{testing_infer::PaperStructure(), {}, {}};
  for (int i = 0; i < 4; ++i) rig.Add("S" + std::to_string(i), RingPose(30 + 85 * i), {true, 3.5});
  rig.labels[0] = LabelImage(320, 288);  // sees no sides, and is not asked
  testing_infer::FlipFrame(rig.structure, &rig.frames[2], &rig.labels[2]);
  const Labelled frames(rig);
  const std::optional<AssemblyReport> report =
      InspectStack(frames.views, frames.labelled, rig.structure, frames.placement());
  ASSERT_TRUE(report.has_value());
  EXPECT_EQ(report->mirrored_frames, (std::vector<std::size_t>{2}));
}

TEST(FramesToRefine, ArePlacedOnesInOrderAndKnowWhatHoldsThem) {
  const Rig rig = NarrowRig();
  Labelled frames(rig);
  frames.options.refine.without_structure = {"S1"};
  std::vector<Placement> placements = frames.Place(rig, std::nullopt);
  std::vector<RefineFrame> sensors = FramesToRefine(rig.frames, frames.labelled, placements,
                                                    GivenLenses(rig.frames), frames.options.refine);
  ASSERT_EQ(sensors.size(), 2u);
  EXPECT_TRUE(sensors[0].use_structure_terms);
  EXPECT_FALSE(sensors[1].use_structure_terms);
  // Only overlap is to hold it: its initial pose is where it begins.
  EXPECT_TRUE(sensors[1].start.isApprox(frames.labelled[1].initial.structure_from_sensor));
  placements[0] = Finding{SensorCode::kNoStructure, "", ""};
  sensors = FramesToRefine(rig.frames, frames.labelled, placements, GivenLenses(rig.frames),
                           frames.options.refine);
  ASSERT_EQ(sensors.size(), 1u);
  EXPECT_EQ(sensors[0].points, &std::get<PlacedSensor>(placements[1]).points);
}

}  // namespace
}  // namespace volalign

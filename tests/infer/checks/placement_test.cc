#include "infer/checks/placement.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "infer/calib/calibrate.h"
#include "infer/checks/assembly.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
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
  EXPECT_TRUE(
      Has(std::get<Finding>(result).hint, "border of its stored picture cuts the structure off"));
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

// Stacks whose boxes were moved by hand here, ray-cast from several sides.

/// Footprint of a box, mm, in its place from the floor.
struct Footprint {
  double x0, x1, z0, z1;
};
constexpr Footprint kBottom{-280, 275, -165, 165}, kMidBottom{-280, 50, -390, 165},
    kMidTop{-505, 50, -165, 165}, kTop{-280, 50, -165, 390};

/// The paper's boxes on other footprints, 405 mm each; a box without area is missing.
Structure Stack(const std::vector<Footprint>& footprints) {
  const Structure described = PaperStructure();
  std::vector<Box> boxes;
  double y = -0.81;
  for (std::size_t i = 0; i < footprints.size(); ++i) {
    const Footprint& f = footprints[i];
    const bool missing = f.x0 == f.x1;
    const Eigen::Vector3d min(f.x0 / 1000, y, f.z0 / 1000);
    const Eigen::Vector3d max(f.x1 / 1000, y + 0.405, f.z1 / 1000);
    if (!missing) y += 0.405;
    if (!missing) boxes.push_back(Box::FromMinMax(described.boxes()[i].name, min, max));
  }
  return Structure::FromBoxes("built", boxes);
}

AssemblyReport InspectViews(const std::vector<SensorView>& views, const Structure& described) {
  std::vector<const SensorView*> asked;
  for (const SensorView& view : views) asked.push_back(&view);
  return InspectAssembly(asked, described, 2);
}

std::vector<SensorView> ViewsOf(const Structure& built, double look_at_y,
                                const std::vector<double>& azimuths_deg = {20, 140, 260}) {
  Rig rig{built, {}, {}};
  for (std::size_t i = 0; i < azimuths_deg.size(); ++i) {
    rig.Add("S" + std::to_string(i),
            RingPose(azimuths_deg[i], 2.1, look_at_y + 0.6, 90, {0, look_at_y, 0}), {true, 3.5});
    AddNoise(&rig.frames.back().depth, 0.003, i);
  }
  std::vector<SensorView> seen;
  for (const SensorFrame& frame : rig.frames)
    seen.push_back(MakeSensorView(frame, frame.intrinsics));
  return seen;
}

struct Case {
  Structure built;
  SensorCode code;
  std::string sentence;
};

TEST(InspectAssembly, NamesWhatIsBuiltWrongly) {
  const Footprint none{0, 0, 0, 0};
  const std::vector<Case> cases = {
      {Stack({kBottom, kMidBottom, kMidTop, kTop}), SensorCode::kNone,
       "the boxes stand as described"},
      // The overhang of mid_bottom on the other side.
      {Stack({kBottom, {-280, 50, -165, 390}, kMidTop, kTop}), SensorCode::kAssemblyTurned,
       "box mid_bottom is turned by 180 deg"},
      {Stack({kBottom, kMidBottom, kTop, kMidTop}), SensorCode::kAssemblySwapped,
       "boxes mid_top and top are swapped"},
      {Stack({kBottom, {-280, 50, -165, 390}, kMidTop, {-280, 50, -390, 165}}),
       SensorCode::kAssemblyMirrored, "the stack or the frames are mirrored"},
      // The spiral without its highest box is the one without its lowest, a quarter turn further.
      {Stack({kBottom, kMidBottom, kMidTop, none}), SensorCode::kAssemblyMissing,
       "box top is missing"},
  };
  for (const Case& c : cases) {
    const AssemblyReport report = InspectViews(ViewsOf(c.built, -0.1), PaperStructure());
    EXPECT_EQ(report.arrangement.code, c.code) << c.sentence;
    EXPECT_TRUE(Has(report.arrangement.sentence, c.sentence)) << ", not " << c.sentence;
    EXPECT_EQ(report.altered(), c.code != SensorCode::kNone);
    EXPECT_GT(report.share, 0.95) << c.sentence;
    EXPECT_EQ(report.seen_by.size(), 3u) << c.sentence;
    EXPECT_TRUE(report.mirrored_frames.empty()) << c.sentence;
  }
}

/// Boxes, each on the one before. Sizes and middles in mm.
Structure OwnBoxes(const std::vector<Eigen::Vector3d>& sizes,
                   const std::vector<Eigen::Vector2d>& middles) {
  std::vector<Box> boxes;
  double foot = 0;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const Eigen::Vector3d low(middles[i].x() - sizes[i].x() / 2, foot,
                              middles[i].y() - sizes[i].z() / 2);
    boxes.push_back(Box::FromMinMax("b" + std::to_string(i), low / 1000, (low + sizes[i]) / 1000));
    foot += sizes[i].y();
  }
  return Structure::FromBoxes("own", boxes);
}

// What others describe wrongly of boxes that are stacked right is a stack that is built wrongly.
TEST(InspectAssembly, NamesWhatIsDescribedWronglyOfOwnBoxes) {
  using Sizes = std::vector<Eigen::Vector3d>;
  using Middles = std::vector<Eigen::Vector2d>;
  const Sizes sizes{{500, 300, 380}, {300, 340, 420}, {480, 260, 330}};
  const Middles middles{{0, 0}, {-60, 40}, {50, -30}};
  const std::vector<SensorView> views = ViewsOf(OwnBoxes(sizes, middles), 0.4, {20, 140});
  const auto sentence = [&](const Sizes& of, const Middles& at) {
    return InspectViews(views, OwnBoxes(of, at)).arrangement.sentence;
  };
  EXPECT_EQ(sentence({{500, 300, 380}, {300, 340, 420}, {330, 260, 480}}, middles),
            "box b2 is turned by 90 deg");
  EXPECT_EQ(sentence({{500, 380, 300}, {300, 340, 420}, {480, 260, 330}}, middles),
            "box b0 lies on another edge");
  const std::string shifted = sentence(sizes, {{0, 0}, {90, 40}, {50, -30}});
  EXPECT_TRUE(Has(shifted, "box b1 is shifted by -1"));
  const std::string higher = sentence({sizes[0], sizes[2]}, {middles[0], middles[2]});
  EXPECT_NE(higher, "the boxes stand as described");
}

TEST(InspectAssembly, SaysNothingOfAStackThatASensorDoesNotSee) {
  const Structure structure = PaperStructure();
  std::vector<SensorView> views = ViewsOf(structure, -0.1);
  // A bare floor and walls.
  const Structure away = structure.Displaced(
      std::vector<Pose>(structure.boxes().size(), Pose(Eigen::Translation3d(0, 0, 50))));
  views[1] = ViewsOf(away, -0.1)[1];
  const AssemblyReport report = InspectViews(views, structure);
  EXPECT_FALSE(report.altered()) << report.arrangement.sentence;
  EXPECT_EQ(report.seen_by, (std::vector<std::size_t>{0, 2}));
}

TEST(InspectAssembly, AFrameIsMirroredBesideOneThatShowsTheStackAsDescribed) {
  const Structure described = PaperStructure();
  Rig rig{described, {}, {}};
  rig.Add("mirrored", RingPose(20, 2.1), {true, 3.5});
  FlipFrame(described, &rig.frames[0], &rig.labels[0]);
  rig.Add("other", RingPose(140, 2.1), {true, 3.5});
  std::vector<SensorView> views;
  for (const SensorFrame& frame : rig.frames)
    views.push_back(MakeSensorView(frame, frame.intrinsics));
  const AssemblyReport report = InspectViews(views, described);
  EXPECT_EQ(report.mirrored_frames, std::vector<std::size_t>{0}) << report.arrangement.sentence;
  EXPECT_FALSE(report.altered());
}

// A box beside the others, that the last view does not show.
TEST(InspectAssembly, AMirroredStackIsOneSlipAndThreeMirroredFramesAreThree) {
  const auto stack = [](double side) {
    return Structure::FromBoxes(
        "own", {Box::FromMinMax("tall", {-0.3, 0, -0.3}, {0.05, 0.6, 0.3}),
                Box::FromMinMax("low", {0.05, 0, side - 0.15}, {0.35, 0.35, side + 0.15})});
  };
  const std::vector<SensorView> views = ViewsOf(stack(-0.1), 0.4, {-50, 0, 50, 180});
  const AssemblyReport report = InspectViews(views, stack(0.1));
  EXPECT_EQ(report.arrangement.code, SensorCode::kAssemblyMirrored) << report.arrangement.sentence;
  EXPECT_TRUE(report.mirrored_frames.empty());
}

}  // namespace
}  // namespace volalign::placement_test

#include "infer/checks/placement.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "infer/calib/calibrate.h"
#include "infer/checks/assembly.h"
#include "infer/checks/neighbours.h"
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

// A sensor of whose view one side alone is labelled, beside two that stand well. Everything else
// that they see, a floor apart, is boxes that stand about.

constexpr std::size_t kLost = 2;

/// A sensor that sees the structure and other boxes, which have no labels.
void AddAmong(const std::vector<Box>& others, const std::string& name, const Pose& pose,
              const Scene& scene, Rig* rig) {
  const Structure structure = rig->structure;
  const std::vector<std::string> sides = structure.SideNames();
  std::vector<Box> boxes = structure.boxes();
  std::vector<std::string> all = sides;
  for (const Box& box : others) {
    boxes.push_back(box);
    for (const std::string side : {"front", "back", "up", "right", "left"})
      all.push_back(box.name + "/" + side);
  }
  rig->structure = Structure::FromBoxes("furnished", boxes, all);
  rig->Add(name, pose, scene);
  rig->structure = structure;
  for (std::uint8_t& label : rig->labels.back()) label = label <= sides.size() ? label : 0;
}

/// How the lost frame is located, by its neighbours alone.
LocateResult LocateLost(const Rig& rig, const CalibrateOptions& options = {}) {
  const LocateOptions locate{options.refine, options.verdict, 2};
  const CaptureSet capture({{"", rig.frames}}, rig.structure);
  const Seen seen = SeenWithLabels(capture, rig.labels);
  const PerFrame<LocateResult> alone = LocateAlone(seen, {std::nullopt}, locate);
  for (std::size_t i = 0; i < kLost; ++i)
    EXPECT_TRUE(std::holds_alternative<LocatedFrame>(alone[{0, i}])) << i;
  EXPECT_TRUE(std::holds_alternative<Finding>(alone[{0, kLost}]));
  return LocateByNeighbours(seen, alone, locate)[{0, kLost}];
}

void ExpectPlaced(const Rig& rig) {
  const LocateResult result = LocateLost(rig);
  const auto* located = std::get_if<LocatedFrame>(&result);
  ASSERT_NE(located, nullptr) << std::get<Finding>(result).reason;
  ASSERT_TRUE(located->by_neighbours.has_value());
  EXPECT_EQ(located->by_neighbours->code, SensorCode::kByNeighbours);
  EXPECT_NE(located->by_neighbours->reason.find("what it sees in common with S0, S1"),
            std::string::npos)
      << located->by_neighbours->reason;
  const PoseError error = ComparePoses(located->own_pose, *rig.frames[kLost].ground_truth);
  EXPECT_LT(error.translation_m, 0.01);
  EXPECT_LT(error.rotation_deg, 0.5);
}

void ExpectNotPlaced(const Rig& rig) {
  const LocateResult result = LocateLost(rig);
  const auto* finding = std::get_if<Finding>(&result);
  ASSERT_NE(finding, nullptr) << std::get<LocatedFrame>(result).by_neighbours->reason;
  EXPECT_EQ(finding->code, SensorCode::kDegenerateSides);
}

/// Leaves the lost sensor the labels of one side.
void LabelOneSide(const std::string& name, Rig* rig) {
  const int label = LabelOf(rig->structure, name);
  for (std::uint8_t& of : rig->labels[kLost]) of = of == label ? of : 0;
}

TEST(LocateByNeighbours, WhatOneSensorSeesThroughSpeaksAgainstAPose) {
  // A curtain of 80 cm was drawn before the wall between the frames of the lost sensor and its
  // neighbours.
  const Structure structure = PaperStructure();
  const std::vector<Box> curtain = {
      Box::FromMinMax("curtain", {-0.4, -0.81, -1.55}, {0.4, 2.5, -1.5})};
  const Scene room{true, 2.5};
  struct Case {
    bool seen_by_neighbours, seen_by_lost;
  };
  for (const Case& c : {Case{true, true}, Case{true, false}, Case{false, true}}) {
    SCOPED_TRACE(testing::Message() << c.seen_by_neighbours << c.seen_by_lost);
    Rig rig{structure, {}, {}};
    const std::vector<Box> nothing;
    AddAmong(c.seen_by_neighbours ? curtain : nothing, "S0", RingPose(60), room, &rig);
    AddAmong(c.seen_by_neighbours ? curtain : nothing, "S1", RingPose(130), room, &rig);
    AddAmong(c.seen_by_lost ? curtain : nothing, "S2", RingPose(95), room, &rig);
    LabelOneSide("mid_bottom/right", &rig);
    if (c.seen_by_neighbours == c.seen_by_lost) {
      ExpectPlaced(rig);
    } else {
      ExpectNotPlaced(rig);
    }
  }
}

// Of all that it sees, a round part of one side is left, on which it could slide.
TEST(LocateByNeighbours, NotWhereWhatIsSharedIsAPartOfOnePlane) {
  Rig rig{PaperStructure(), {}, {}};
  for (const double phi : {60, 130, 95})
    rig.Add("S" + std::to_string(rig.frames.size()), RingPose(phi), {true, 2.5});
  LabelOneSide("mid_bottom/right", &rig);
  const Side& side = rig.structure.SideOfLabel(LabelOf(rig.structure, "mid_bottom/right"));
  SensorFrame& lost = rig.frames[kLost];
  const SensorView view = MakeSensorView(lost, lost.intrinsics);
  int left = 0;
  for (const auto [u, v] : Pixels(view)) {
    const double away = (*lost.ground_truth * view.Point(u, v) - side.centre).norm();
    std::uint8_t& label = rig.labels[kLost](u, v);
    label = away < 0.15 ? label : 0;
    left += label > 0;
    if (label == 0) lost.depth(u, v) = 0;
  }
  ASSERT_GT(left, 1000);
  ExpectNotPlaced(rig);
}

TEST(LocateByNeighbours, NotWhereAnotherPoseDoesAsWell) {
  // A row of posts behind the structure. Of one side, the lost sensor sees a strip of 22 cm; of
  // the rest, some of the posts and the floor round them. Where there is a post every 30 cm, the
  // view is the same 30 cm further along the side.
  for (const double apart : {0.3, 0.75}) {
    SCOPED_TRACE(apart);
    std::vector<Box> others;
    for (double z = -2.1; z < 2.15; z += apart) {
      others.push_back(Box::FromMinMax("post " + std::to_string(z), {-1.2, -0.81, z - 0.07},
                                       {-1.05, 1.6, z + 0.07}));
    }
    // Boards that carry the side on, so that the strip has no borders that would tell.
    others.push_back(Box::FromMinMax("board", {-0.1, -0.405, 0.165}, {0.05, 0, 1.2}));
    others.push_back(Box::FromMinMax("other board", {-0.1, -0.405, -1.2}, {0.05, 0, -0.39}));
    Rig rig{PaperStructure(), {}, {}};
    AddAmong(others, "S0", RingPose(-30), {}, &rig);
    AddAmong(others, "S1", RingPose(30), {}, &rig);
    AddAmong(others, "S2", RingPose(0, 1.6, 0.3), {}, &rig);
    for (std::size_t i = 0; i < rig.frames.size(); ++i) AddNoise(&rig.frames[i].depth, 0.002, i);
    LabelOneSide("mid_bottom/front", &rig);
    SensorFrame& lost = rig.frames[kLost];
    for (const auto [u, v] : Pixels(lost.depth)) {
      const Eigen::Vector2d ray = RayThroughLens(lost.intrinsics, static_cast<double>(u), v);
      const Eigen::Vector3d p =
          *lost.ground_truth * Eigen::Vector3d(lost.depth(u, v) * ray.homogeneous());
      const bool strip = rig.labels[kLost](u, v) > 0 && p.z() < -0.17;
      const bool flush = std::abs(p.x() - 0.05) < 0.03 && p.y() < 0 && std::abs(p.z()) < 0.9;
      const bool beside = p.x() < -0.5 && std::abs(p.z()) > 0.9;
      if (!strip) rig.labels[kLost](u, v) = 0;
      if (!strip && !flush && !beside) lost.depth(u, v) = 0;
    }
    if (apart < 0.5) {
      ExpectNotPlaced(rig);
    } else {
      ExpectPlaced(rig);
    }
  }
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

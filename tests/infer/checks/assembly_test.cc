// Stacks whose boxes were moved by hand here, ray-cast from several sides.

#include "infer/checks/assembly.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <string>
#include <vector>

#include "tests/core/base/expect_error.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::assembly_test {
namespace {

using namespace testing_infer;

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
}  // namespace volalign::assembly_test

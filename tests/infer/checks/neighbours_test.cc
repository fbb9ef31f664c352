// A sensor of whose view one side alone is labelled, beside two that stand well. Everything else
// that they see, a floor apart, is boxes that stand about.

#include "infer/checks/neighbours.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "infer/calib/calibrate.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/checks/seen_with_labels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::neighbours_test {
namespace {

using namespace testing_infer;

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

}  // namespace
}  // namespace volalign::neighbours_test

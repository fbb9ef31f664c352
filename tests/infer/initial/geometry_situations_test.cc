#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "core/base/odds.h"
#include "core/geometry/visibility.h"
#include "infer/calib/calibrate.h"
#include "infer/initial/pose_hypotheses.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/initial/geometry_frames.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::geometry_situations_test {
namespace {

using namespace testing_infer;

// What a user's room does to the search for a first pose by geometry: whatever is found has to be
// the true pose, or one of several that the sensor is then ambiguous between.

/// From where something near hides a part of the picture.
enum class From { kLeft, kRight, kBelow };

/// Puts a board 0.6 m before the sensor, whose picture lies on its side with +x down, so that it
/// hides a share of the structure's pixels.
void Hide(double share, From from, SyntheticView* view) {
  const bool columns = from == From::kBelow;
  std::vector<int> at;
  for (const auto [u, v] : Pixels(view->depth)) {
    if (view->labels(u, v) > 0) at.push_back(columns ? u : v);
  }
  ASSERT_FALSE(at.empty());
  std::sort(at.begin(), at.end());
  const bool from_zero = from == From::kLeft;
  const auto edge = static_cast<double>(at.size() - 1) * (from_zero ? share : 1 - share);
  const int limit = at[static_cast<std::size_t>(edge)];
  for (const auto [u, v] : Pixels(view->depth)) {
    const int place = columns ? u : v;
    if (from_zero ? place >= limit : place <= limit) continue;
    view->depth(u, v) = 0.6f;
    view->labels(u, v) = 0;
  }
}

SensorView Measured(SyntheticView view) {
  AddNoise(&view.depth, 0.005, 1);
  return MakeSensorView(view.depth, Kinect());
}

/// A pose that is chosen unambiguously is the true one: to 5 cm and 2 deg, or, where a sensor
/// sees too little for that, to what still counts as the same place (10 cm, 5 deg).
void ExpectNotWrong(const PoseChoice& choice, const Pose& truth, bool sees_little = false) {
  if (!choice.found || choice.ambiguous()) return;
  if (!sees_little) return ExpectChosen(choice, truth);
  EXPECT_TRUE(Within(ComparePoses(choice.best.structure_from_sensor, truth), 0.1, 5));
}

TEST(Situations, HalfHidden) {
  std::map<double, int> chosen;  // of nine each; found: 9, 7, 6
  for (const std::uint64_t seed : {0, 1, 2}) {
    const Structure structure = seed == 0 ? PaperStructure() : RandomStack(seed);
    const double y = structure.FloorHeight() + structure.Height() / 2;
    const Pose truth = RingPose(35.0 + 70 * static_cast<double>(seed), 2.2, y + 0.5, 90, {0, y, 0});
    for (const From from : {From::kLeft, From::kRight, From::kBelow}) {
      for (const double share : {0.15, 0.35, 0.6}) {
        SCOPED_TRACE(std::to_string(seed) + ", from " + std::to_string(static_cast<int>(from)) +
                     ": " + std::to_string(share));
        SyntheticView seen = Render(structure, Kinect(), truth, {true, 3.5});
        Hide(share, from, &seen);
        const SensorView view = Measured(seen);
        const PoseChoice choice = Choose(view, structure);
        ExpectNotWrong(choice, truth, share > 0.5);
        chosen[share] += choice.found && !choice.ambiguous();
        if (share < 0.2) {
          EXPECT_TRUE(Contains(Find(view, structure), truth));
        }
      }
    }
  }
  EXPECT_GE(chosen[0.15], 8);
  EXPECT_GE(chosen[0.35], 6);
  EXPECT_GE(chosen[0.6], 5);
}

// A sensor that stands near shows a part of the stack only: under a fifth of its surface.
TEST(Situations, CutByThePicturesBorder) {
  const Structure structure = PaperStructure();
  int found = 0;
  for (int i = 0; i < 8; ++i) {
    SCOPED_TRACE(i);
    const Pose truth = RingPose(45.0 * i, 1.5, 0.55, 0, {0.1 * (i % 3), -0.15, 0.1});
    const SensorView view = Measured(Render(structure, Kinect(), truth, {true, 3.5}));
    ExpectNotWrong(Choose(view, structure), truth);
    found += Contains(Find(view, structure), truth);
  }
  EXPECT_GE(found, 7);
}

TEST(Situations, AFloorThatIsUnevenByTwoCentimetres) {
  const Structure structure = PaperStructure();
  for (int i = 0; i < 4; ++i) {
    SCOPED_TRACE(i);
    const Pose truth = RingPose(20.0 + 90 * i, 2.2, 0.4);
    SyntheticView seen = Render(structure, Kinect(), truth, {true, 3.5});
    const SensorView exact = MakeSensorView(seen.depth, Kinect());
    for (const auto [u, v] : Pixels(exact)) {
      if (seen.labels(u, v) > 0 || !(exact.depth(u, v) > 0)) continue;
      const Eigen::Vector3d p = truth * exact.Point(u, v);
      const double fall = truth.translation().y() - p.y();
      if (p.y() > structure.FloorHeight() + 0.001 || !(fall > 0.1)) continue;
      // Along the ray, so that the floor is higher by this.
      const double bump = 0.02 * std::sin(7 * p.x()) * std::cos(6 * p.z() + 1);
      seen.depth(u, v) *= static_cast<float>(1 - bump / fall);
    }
    ExpectChosen(Choose(Measured(seen), structure), truth);
  }
}

Pose Upright(double yaw_deg, double height) {
  return MakePose({0, yaw_deg * M_PI / 180, 0}, {0, height, 0});
}

Labelling MakeLabelling(int turns, const SegmentationResult& labels, bool found = false,
                        double height = 0) {
  Labelling labelling;
  labelling.turns = turns;
  labelling.segmentation = labels;
  labelling.initial.found = found;
  labelling.initial.structure_from_sensor = Upright(0, height);
  return labelling;
}

TEST(FindHypotheses, AreThePosesOfLabellingsAndTheirSymmetricOnes) {
  // Nothing was measured or labelled, so that no pose is estimated again.
  const SensorView view = MakeSensorView(DepthImage(20, 10), Coarse());
  const SegmentationResult labels = Certain(LabelImage(20, 10));
  const Labelling none = MakeLabelling(0, labels, false, 4),
                  two = MakeLabelling(1, labels, true, 2), one = MakeLabelling(3, labels, true, 1);
  std::vector<StructureSymmetry> symmetries(2);
  symmetries[0].motion = MakePose({M_PI, 0, 0}, {0, 0, 0});
  symmetries[1].motion = Upright(90, 0.4);
  const auto poses_of = [&](const std::vector<const Labelling*>& of, bool known_up) {
    return FindHypotheses(view, PaperStructure(), symmetries, of, known_up, PoseMethod::kNetwork);
  };
  struct Expected {
    std::size_t labelling;
    int symmetry;
    double height;
    int turns;
  };
  const std::vector<Expected> expected = {{1, -1, 2, 1}, {1, 0, -2, 3}, {1, 1, 2.4, 1},
                                          {2, -1, 1, 3}, {2, 0, -1, 1}, {2, 1, 1.4, 3}};
  const std::vector<Hypothesis> all = poses_of({&none, &two, &one}, false);
  ASSERT_EQ(all.size(), expected.size());
  for (std::size_t k = 0; k < all.size(); ++k) {
    EXPECT_EQ(all[k].labelling, expected[k].labelling) << k;
    EXPECT_EQ(all[k].symmetry, expected[k].symmetry) << k;
    EXPECT_EQ(all[k].turns, expected[k].turns) << k;
    EXPECT_NEAR(all[k].structure_from_sensor.translation().y(), expected[k].height, 1e-12) << k;
  }
  const std::vector<Hypothesis> upright = poses_of({&none, &two, &one}, true);
  ASSERT_EQ(upright.size(), 4u);
  for (const Hypothesis& pose : upright) {
    EXPECT_NE(pose.symmetry, 0);
    EXPECT_EQ(pose.turns, 0) << "given";
  }
  EXPECT_TRUE(poses_of({&none}, false).empty());
}

// A rendered view of the paper's stack, labelled rightly in one orientation, not at all in another,
// and as a step of its spiral has it in a third.
TEST(WeighHypotheses, EachFactorSpeaksForWhatIsRight) {
  const Structure structure = PaperStructure();
  const Pose truth = RingPose(40);
  const Intrinsics kinect = Kinect();
  const auto rendered = Render(structure, kinect, truth, {true, 3.5});
  const SensorView view = MakeSensorView(rendered.depth, kinect);
  const std::vector<StructureSymmetry> symmetries = FindSymmetries(structure);
  const auto step =
      std::find_if(symmetries.begin(), symmetries.end(),
                   [](const StructureSymmetry& symmetry) { return symmetry.keeps_up(); });
  const auto over =
      std::find_if(symmetries.begin(), symmetries.end(),
                   [](const StructureSymmetry& symmetry) { return !symmetry.keeps_up(); });
  ASSERT_NE(step, symmetries.end());
  ASSERT_NE(over, symmetries.end());
  const ExpectedView moved = CastView(structure, view.rays, step->motion * truth);
  LabelImage after_step = moved.labels;  // of the sides that are in the same places
  for (std::size_t i = 0; i < after_step.size(); ++i) {
    if (std::abs(moved.depth[i] - view.depth[i]) > 0.01) after_step[i] = 0;
  }
  const Labelling right = MakeLabelling(0, Certain(rendered.labels)),
                  empty = MakeLabelling(0, Certain(LabelImage(320, 288))),
                  shifted = MakeLabelling(0, Certain(after_step));
  std::vector<Hypothesis> poses(3);
  poses[0].structure_from_sensor = truth;
  poses[1].structure_from_sensor = step->motion * truth;
  poses[2].structure_from_sensor = over->motion * truth;
  const auto weigh = [&](const std::vector<const Labelling*>& labellings) {
    WeighHypotheses(view, structure, labellings, &poses);
  };
  const double decisive = std::log(kDecisiveOdds);
  weigh({&empty, &right});
  // A step that moves three of four boxes onto boxes leaves the fourth unexplained, and the floor
  // is a box lower; upside down every box is one, and only the floor tells.
  EXPECT_GT(poses[0].by_outline, poses[1].by_outline + decisive);
  EXPECT_GT(poses[0].by_floor, poses[1].by_floor + decisive);
  EXPECT_GT(poses[0].by_floor, poses[2].by_floor + decisive);
  EXPECT_NEAR(poses[0].by_depth, poses[2].by_depth, 0.5);
  EXPECT_NEAR(poses[0].by_outline, poses[2].by_outline, 0.5);
  // Labels: of the labelling that knows the pose.
  weigh({&empty, &right, &shifted});
  EXPECT_GT(poses[0].by_labels, 2);
  EXPECT_GT(poses[1].by_labels, 0) << "the third labelling names its sides";
  EXPECT_LT(poses[2].by_labels, -decisive);
  // Without a labelling there are no labels.
  for (Hypothesis& pose : poses) pose.source = PoseSource::kGeometry;
  weigh({});
  EXPECT_EQ(poses[0].by_outline, 0);
  EXPECT_EQ(poses[0].by_labels, 0);
}

}  // namespace
}  // namespace volalign::geometry_situations_test

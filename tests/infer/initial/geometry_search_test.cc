#include "infer/initial/geometry_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/base/odds.h"
#include "core/geometry/metrics.h"
#include "core/geometry/visibility.h"
#include "infer/initial/box_fit.h"
#include "infer/initial/floor.h"
#include "infer/initial/orientation.h"
#include "infer/initial/oriented_points.h"
#include "infer/initial/pose_hypotheses.h"
#include "infer/initial/symmetries.h"
#include "tests/core/base/long_tests.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/initial/geometry_frames.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::geometry_search_test {
namespace {

using namespace testing_infer;

TEST(FindPosesByGeometry, TheFloorDecidesBetweenThePapersStackAndItUpsideDown) {
  const Structure structure = PaperStructure();
  for (int i = 0; i < 8; ++i) {
    SCOPED_TRACE(i);
    const Pose truth = RingPose(45.0 * i, 2.0 + 0.2 * i, 0.3 + 0.05 * (i % 3));
    ExpectChosen(Choose(See(structure, truth), structure), truth);
  }
}

TEST(FindPosesByGeometry, AnyStackOfBoxes) {
  for (std::uint64_t seed = 0; seed < Rounds(3, 6); ++seed) {
    const Structure structure = RandomStack(seed);
    const Eigen::Vector3d middle(0, structure.Height() / 2, 0);
    for (int i = 0; i < 3; ++i) {
      SCOPED_TRACE(std::to_string(seed) + ": " + std::to_string(i));
      const Pose truth = RingPose(20.0 + 90 * i, 1.8 + 0.4 * i, 1.2, 90, middle);
      ExpectChosen(Choose(See(structure, truth), structure), truth);
    }
  }
}

TEST(FindPosesByGeometry, ASensorMayBeRolledByAnyAngle) {
  const Structure structure = PaperStructure();
  for (const double roll : {0.0, 37.0, 180.0, 250.0}) {
    SCOPED_TRACE(roll);
    const Pose truth = RingPose(70, 2.3, 0.5, roll);
    ExpectChosen(Choose(See(structure, truth), structure), truth);
  }
}

TEST(FindPosesByGeometry, WithoutAFloorEveryPoseThatTheViewAllows) {
  const Structure structure = PaperStructure();
  // From where sides that face in three directions are seen.
  for (const double phi : {35.0, 215.0}) {
    SCOPED_TRACE(phi);
    const Pose truth = RingPose(phi, 2.2, 0.4);
    const SensorView view = See(structure, truth, {false, 0});
    EXPECT_TRUE(Contains(Find(view, structure), truth));
    EXPECT_TRUE(Choose(view, structure).ambiguous());
  }
}

// A view that shows more of the stack at a pose that only looks alike was given no pose: that one
// ranks first, has not the shape by little, and took the right one with it.
TEST(FindPosesByGeometry, APoseThatShowsMoreTakesTheRightOneNotWithIt) {
  const Structure structure = PaperStructure();
  const std::vector<StructureSymmetry> symmetries = FindSymmetries(structure);
  int cases = 0;
  for (int i = 0; i < 50 && cases < 8; ++i) {
    const Pose truth = RingPose(7.0 * i, 1.3 + 0.2 * (i % 5), 0.2 + 0.1 * (i % 4), 90,
                                {0.15 * (i % 3) - 0.15, 0.3 * (i % 7) - 0.9, 0});
    const SensorView view = See(structure, truth);
    const SensorSurface surface = LookAround(view, structure).surface;
    const std::vector<OrientedPoint> points = PointsOf(surface);
    const auto fitted = [&](const Pose& pose) {
      return MeasureShape(surface, structure,
                          FitToBoxes(points, structure, {4, 1500, 0.05, 0.03, false}, pose));
    };
    const ViewFit right = fitted(truth);
    if (!HasShape(right)) continue;
    const bool outdone =
        std::any_of(symmetries.begin(), symmetries.end(), [&](const StructureSymmetry& symmetry) {
          const ViewFit other = fitted(symmetry.motion * truth);
          return other.explained > right.explained && !HasShape(other);
        });
    if (!outdone) continue;
    ++cases;
    SCOPED_TRACE(i);
    EXPECT_TRUE(Contains(Find(view, structure), truth));
  }
  EXPECT_EQ(cases, 8);
}

// One family of upright planes tells nothing of a turn about their normal. What reaches under the
// structure contradicts a pose, unless it is seen to stand on a table.
TEST(FindPosesByGeometry, FromTheFrontWithoutAFloor) {
  const Structure structure = PaperStructure();
  // The front and a side, else all four.
  for (std::uint64_t i = 0; i < Rounds(2, 4); ++i) {
    for (const double wall : {0.0, 3.5}) {
      SCOPED_TRACE(std::to_string(i) + (wall > 0 ? " in a room" : ""));
      const Pose truth = RingPose(90.0 * static_cast<double>(i), 2.2, 0.2);
      const SensorView view = See(structure, truth, {false, wall});
      EXPECT_EQ(Contains(Find(view, structure), truth), wall == 0);
      if (wall == 0) {
        EXPECT_TRUE(Choose(view, structure).ambiguous());
      }
    }
  }
}

// With and without the room's floor, 0.7 m under the table.
TEST(FindPosesByGeometry, OnATable) {
  const Structure stack =
      Structure::FromBoxes("stack", {Standing("low", {0.5, 0.3, 0.35}, {0, 0, 0}),
                                     Standing("high", {0.3, 0.4, 0.3}, {0.1, 0.3, 0.02}, 25)});
  std::vector<Box> with_table = stack.boxes();
  with_table.push_back(Standing("table", {1.2, 0.7, 0.9}, {0.2, -0.7, 0.1}));
  const Structure seen = Structure::FromBoxes("stack on a table", with_table);
  const Pose truth = RingPose(60, 2.0, 0.9, 90, {0, 0.2, 0});
  for (const bool floor : {true, false}) {
    SCOPED_TRACE(floor);
    ExpectChosen(Choose(See(seen, truth, {floor, 3.5}), stack), truth);
  }
}

// Small boxes on a table, one before the other: their faces lie in one plane by its tolerances, but
// not side by side, and together they are larger than any of the structure.
TEST(FindPosesByGeometry, SmallBoxesBesideAnotherInOnePlane) {
  const Structure stack =
      Structure::FromBoxes("stack", {Standing("large", {0.24, 0.23, 0.16}, {0, 0, 0}),
                                     Standing("small", {0.14, 0.19, 0.06}, {0.2, 0, 0.35}, 40)});
  std::vector<Box> seen = stack.boxes();
  seen.push_back(Standing("other", {0.2, 0.23, 0.1}, {0.32, 0, -0.03}));
  seen.push_back(Standing("table", {1.4, 0.7, 1.0}, {0.1, -0.7, 0.1}));
  const Pose truth = LookAt({0.3, 0.6, 1.4}, {0.1, 0.05, 0.1}, 0);
  ExpectChosen(Choose(See(Structure::FromBoxes("seen", seen), truth, {false, 2.5}), stack), truth);
}

TEST(FindPosesByGeometry, NothingInARoomWithoutTheStack) {
  const Structure structure = PaperStructure();
  Structure elsewhere =
      structure.Displaced(std::vector<Pose>(4, Pose(Eigen::Translation3d(100, 0, 0))));
  for (const bool floor : {true, false}) {
    for (int i = 0; i < 2; ++i) {
      SCOPED_TRACE(i);
      EXPECT_TRUE(Find(See(elsewhere, RingPose(50.0 * i), {floor, 2.5}), structure).empty());
    }
  }
}

TEST(FindPosesByGeometry, NothingBeforeAWall) {
  const Structure structure = PaperStructure();
  const SensorView wall = MakeSensorView(DepthImage(320, 288, 1.5f), Kinect());
  EXPECT_TRUE(Find(wall, structure).empty());
  EXPECT_TRUE(Find(MakeSensorView(DepthImage(320, 288, 0.0f), Kinect()), structure).empty());
}

TEST(FindPosesByGeometry, ASymmetricStackIsAmbiguousOnAFloor) {
  const std::vector<Structure> stacks = {
      Structure::FromBoxes("one", {Standing("one", {0.5, 0.4, 0.3}, {0, 0, 0})}),
      Structure::FromBoxes("two", {Standing("a", {0.4, 0.35, 0.3}, {-0.2, 0, 0}),
                                   Standing("b", {0.4, 0.35, 0.3}, {0.2, 0, 0})}),
      Structure::FromBoxes("column", {Standing("a", {0.4, 0.4, 0.4}, {0, 0, 0}),
                                      Standing("b", {0.4, 0.4, 0.4}, {0, 0.4, 0})})};
  for (const Structure& structure : stacks) {
    SCOPED_TRACE(structure.name());
    const Pose truth = RingPose(35, 1.8, 0.9, 90, {0, 0.2, 0});
    const SensorView view = See(structure, truth);
    EXPECT_TRUE(Contains(Find(view, structure), truth));
    EXPECT_TRUE(Choose(view, structure).ambiguous());
  }
}

// Which orientations are tried, and in how many passes, counted by a segmenter that knows the
// answer.

/// Labels a frame rightly in one orientation and finds nothing in the others.
class OrientedSegmenter : public Segmenter {
 public:
  using Segmenter::Segment;
  std::vector<SegmentationResult> Segment(
      const std::vector<SegmentationRequest>& requests) override {
    std::vector<std::pair<const DepthImage*, int>> pass;
    std::vector<SegmentationResult> results;
    for (const SegmentationRequest& request : requests) {
      pass.emplace_back(request.depth, request.quarter_turns);
      const auto& [turns, labels] = answers.at(request.depth);
      results.push_back(Certain(request.quarter_turns == turns
                                    ? labels
                                    : LabelImage(request.depth->width(), request.depth->height())));
    }
    passes.push_back(std::move(pass));
    return results;
  }
  std::map<const DepthImage*, std::pair<int, LabelImage>> answers;
  std::vector<std::vector<std::pair<const DepthImage*, int>>> passes;
};

struct Frames {
  Structure structure = PaperStructure();
  Intrinsics intrinsics = Kinect();
  std::vector<SensorView> views;
  std::vector<LabelImage> labels;
  OrientedSegmenter segmenter;

  /// `turns`: in which the network knows each.
  explicit Frames(const std::vector<int>& turns) {
    for (std::size_t i = 0; i < turns.size(); ++i) {
      const auto rendered =
          Render(structure, intrinsics, RingPose(40 + 60 * static_cast<double>(i)), {true, 3.5});
      views.push_back(MakeSensorView(rendered.depth, intrinsics));
      labels.push_back(rendered.labels);
    }
    for (std::size_t i = 0; i < turns.size(); ++i)
      segmenter.answers[&views[i].depth] = {turns[i], labels[i]};
  }
  std::vector<Labelled> Label(const std::vector<int>& given, std::size_t unusable = 99) {
    std::vector<LabelRequest> unlabelled;
    for (std::size_t i = 0; i < views.size(); ++i)
      unlabelled.push_back({&views[i], &intrinsics, given[i], i != unusable});
    StageClock clock;
    return LabelViews(unlabelled, structure, &segmenter, InitialPoseOptions(), 1, &clock);
  }
  /// Turns that were tried of a view, in order.
  std::vector<int> Tried(std::size_t i) const {
    std::vector<int> turns;
    for (const auto& pass : segmenter.passes) {
      for (const auto& [depth, turn] : pass) {
        if (depth == &views[i].depth) turns.push_back(turn);
      }
    }
    return turns;
  }
};

TEST(LabelViews, TheTurnThatSuitsTheFirstSensorIsTriedOnTheOthers) {
  Frames frames({1, 1, 1});
  const std::vector<Labelled> labelled = frames.Label({kAutoTurns, kAutoTurns, kAutoTurns});
  EXPECT_EQ(frames.Tried(0), (std::vector<int>{0, 1, 2, 3}));
  EXPECT_EQ(frames.Tried(1), (std::vector<int>{0, 1}));
  EXPECT_EQ(frames.Tried(2), (std::vector<int>{0, 1}));
  EXPECT_EQ(frames.segmenter.passes.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(labelled[i].quarter_turns, 1);
    EXPECT_EQ(labelled[i].segmentation.labels, frames.labels[i]);
    EXPECT_TRUE(labelled[i].initial.found);
    EXPECT_EQ(labelled[i].other_pose, "");
  }
}

TEST(LabelViews, ASensorThatIsMountedOtherwiseIsTriedInAllOrientations) {
  Frames frames({1, 3, 1});
  const std::vector<Labelled> labelled = frames.Label({kAutoTurns, kAutoTurns, kAutoTurns});
  EXPECT_EQ(frames.Tried(1), (std::vector<int>{0, 1, 2, 3}));
  EXPECT_EQ(frames.Tried(2), (std::vector<int>{0, 1}));
  EXPECT_EQ(labelled[1].quarter_turns, 3);
  EXPECT_EQ(labelled[1].segmentation.labels, frames.labels[1]);
}

// Given turns are not doubted, even where the network finds nothing in them.
TEST(LabelViews, GivenTurnsCostOnePass) {
  Frames frames({1, 2, 0});
  const std::vector<Labelled> labelled = frames.Label({1, 3, kAutoTurns});
  EXPECT_EQ(frames.segmenter.passes.size(), 1u);
  EXPECT_EQ(frames.Tried(1), std::vector<int>{3});
  EXPECT_EQ(labelled[0].quarter_turns, 1);
  EXPECT_EQ(labelled[1].quarter_turns, 3);
  EXPECT_EQ(labelled[2].quarter_turns, 0);
}

TEST(LabelViews, APictureThatTheNetworkTakesForASymmetryHasTheTruePose) {
  // In the orientation that suits it the network names the sides that the stack would show after
  // a motion that brings three or four boxes onto boxes. Only the floor tells that the stack does
  // not hang from the ceiling, which its best one, half a turn about a diagonal, takes it for.
  const std::vector<StructureSymmetry> symmetries = FindSymmetries(PaperStructure());
  EXPECT_EQ(symmetries.front().boxes, 4);
  for (std::size_t a = 0; symmetries.at(a).boxes >= 3; ++a) {
    SCOPED_TRACE(a);
    Frames frames({symmetries[a].keeps_up() ? 1 : 3});
    LabelImage& seen = frames.segmenter.answers[&frames.views[0].depth].second;
    const LabelImage moved =
        CastView(frames.structure, frames.views[0].rays, symmetries[a].motion * RingPose(40))
            .labels;
    for (std::size_t i = 0; i < seen.size(); ++i) seen[i] = seen[i] > 0 ? moved[i] : 0;
    const Labelled labelled = frames.Label({kAutoTurns}).at(0);
    EXPECT_EQ(labelled.quarter_turns, 1);
    EXPECT_EQ(labelled.other_pose, "");
    EXPECT_TRUE(
        Within(ComparePoses(labelled.initial.structure_from_sensor, RingPose(40)), 0.02, 1));
    MiouOptions options;
    options.num_classes = frames.structure.num_classes();
    EXPECT_GT(
        MeanIou(labelled.segmentation.labels, frames.labels[0], frames.views[0].depth, options),
        0.95);
  }
}

TEST(LabelViews, AFrameThatTheNetworkDoesNotKnowHasTheFloorAtTheBottom) {
  Frames frames({0});
  frames.segmenter.answers[&frames.views[0].depth].second = LabelImage(320, 288);
  const Labelled labelled = frames.Label({kAutoTurns}).at(0);
  EXPECT_EQ(labelled.source, PoseSource::kGeometry);
  ASSERT_NE(UprightTurns(RingPose(40)), 0);
  EXPECT_EQ(labelled.quarter_turns, UprightTurns(RingPose(40)));
}

TEST(LabelViews, AFrameThatIsNotUsableIsNeverSegmented) {
  Frames frames({0, 0});
  const std::vector<Labelled> labelled = frames.Label({kAutoTurns, kAutoTurns}, 0);
  EXPECT_TRUE(frames.Tried(0).empty());
  EXPECT_FALSE(labelled[0].initial.found);
  EXPECT_EQ(labelled[0].segmentation.labels, LabelImage(320, 288));
  EXPECT_TRUE(labelled[1].initial.found);
}

/// Of the rays that hit this box: those, and of them the marked ones.
std::pair<int, int> CountMarked(const SensorSurface& surface, const Structure& structure, int box,
                                const Pose& pose) {
  std::pair<int, int> counts;
  const ExpectedView seen = CastView(structure, surface.view.rays, pose);
  for (const auto [u, v] : Pixels(surface.view)) {
    const int label = seen.labels(u, v);
    if (label == 0 || structure.SideOfLabel(label).box != box) continue;
    if (!(surface.normals(u, v).squaredNorm() > 0)) continue;
    ++counts.first;
    counts.second += surface.room(u, v);
  }
  return counts;
}

// A side of a box that lies in one plane with a wall is marked as the room's only where they touch.
TEST(MarkRoom, LargePartsOfLargePlanes) {
  for (const double gap : {0.0, 1.0}) {
    SCOPED_TRACE(gap);
    const Structure scene =
        Structure::FromBoxes("scene", {Standing("wall", {1.6, 1.6, 0.2}, {-0.8 - gap, -0.4, 0}),
                                       Standing("box", {0.4, 0.4, 0.2}, {0.2, 0.1, 0})});
    const Pose pose = RingPose(90, 2.6, 0.4, 0, {-0.3, 0.3, 0});
    SensorSurface surface = MakeSensorSurface(See(scene, pose, {false, 0}), 10000);
    MarkRoom(FindRoomPlanes(PointsOf(surface), 10, surface.view.errors), 0.5, &surface);
    const auto [wall, marked_wall] = CountMarked(surface, scene, 0, pose);
    const auto [box, marked_box] = CountMarked(surface, scene, 1, pose);
    ASSERT_GT(wall, 500);
    ASSERT_GT(box, 100);
    EXPECT_GT(marked_wall, 0.9 * wall);
    EXPECT_EQ(marked_box > 0.5 * box, gap == 0);
    EXPECT_EQ(marked_box == 0, gap > 0);
  }
}

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
}  // namespace volalign::geometry_search_test

#include "infer/initial/orientation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "core/geometry/metrics.h"
#include "core/geometry/visibility.h"
#include "infer/initial/floor.h"
#include "infer/initial/oriented_points.h"
#include "infer/initial/symmetries.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/initial/geometry_frames.h"
#include "tests/infer/view/synthetic.h"

// Which orientations are tried, and in how many passes, counted by a segmenter that knows the
// answer.
namespace volalign::orientation_test {
namespace {

using namespace testing_infer;

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

TEST(LabelViews, APictureThatTheNetworkTakesForAStructureUpsideDownIsTurnedRound) {
  // In the orientation 3 the network names the sides that the stack would show after half a turn
  // about its horizontal diagonal; only the floor tells that it does not hang from the ceiling.
  Frames frames({3});
  const std::vector<StructureSymmetry> symmetries = FindSymmetries(frames.structure);
  const auto over =
      std::find_if(symmetries.begin(), symmetries.end(),
                   [](const StructureSymmetry& symmetry) { return !symmetry.keeps_up(); });
  ASSERT_NE(over, symmetries.end());
  ASSERT_EQ(over->boxes, 4);
  LabelImage& seen = frames.segmenter.answers[&frames.views[0].depth].second;
  const LabelImage moved =
      CastView(frames.structure, frames.views[0].rays, over->motion * RingPose(40)).labels;
  for (std::size_t i = 0; i < seen.size(); ++i) seen[i] = seen[i] > 0 ? moved[i] : 0;
  const Labelled labelled = frames.Label({kAutoTurns}).at(0);
  EXPECT_EQ(labelled.quarter_turns, 1);
  EXPECT_EQ(labelled.other_pose, "");
  EXPECT_TRUE(Within(ComparePoses(labelled.initial.structure_from_sensor, RingPose(40)), 0.02, 1));
  MiouOptions options;
  options.num_classes = frames.structure.num_classes();
  EXPECT_GT(MeanIou(labelled.segmentation.labels, frames.labels[0], frames.views[0].depth, options),
            0.95);
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

}  // namespace
}  // namespace volalign::orientation_test

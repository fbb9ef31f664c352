// Which orientations are tried, and in how many passes, counted by a segmenter that knows the
// answer.

#include "infer/initial/orientation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "infer/initial/aliases.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::orientation_test {
namespace {

using testing_infer::Certain;
using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::RingPose;

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
    return LabelViews(unlabelled, structure, &segmenter, InitialPoseOptions(), OrientationOptions(),
                      1, &clock);
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

TEST(LabelViews, GivenTurnsCostOnePass) {
  Frames frames({1, 3, 0});
  const std::vector<Labelled> labelled = frames.Label({1, 3, kAutoTurns});
  EXPECT_EQ(frames.segmenter.passes.size(), 1u);
  EXPECT_EQ(labelled[0].quarter_turns, 1);
  EXPECT_EQ(labelled[1].quarter_turns, 3);
  EXPECT_EQ(labelled[2].quarter_turns, 0);
}

TEST(LabelViews, APictureThatTheNetworkTakesForAStructureUpsideDownIsTurnedRound) {
  // In the orientation 3 the network names the sides that the stack would show after half a turn
  // about its horizontal diagonal; only the floor tells that it does not hang from the ceiling.
  Frames frames({3});
  const std::vector<StructureAlias> aliases = FindAliases(frames.structure);
  const auto over = std::find_if(aliases.begin(), aliases.end(),
                                 [](const StructureAlias& alias) { return !alias.keeps_up(); });
  ASSERT_NE(over, aliases.end());
  ASSERT_EQ(over->boxes, 4);
  LabelImage& seen = frames.segmenter.answers[&frames.views[0].depth].second;
  for (std::uint8_t& label : seen) label = over->label_after[label];
  const Labelled labelled = frames.Label({kAutoTurns}).at(0);
  EXPECT_EQ(labelled.quarter_turns, 1);
  EXPECT_EQ(labelled.other_pose, "");
  const PoseError error = ComparePoses(labelled.initial.structure_from_sensor, RingPose(40));
  EXPECT_LT(error.translation_m, 0.02);
  EXPECT_LT(error.rotation_deg, 1);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (!(seen[i] > 0)) continue;
    ASSERT_EQ(labelled.segmentation.labels[i], frames.labels[0][i]);
  }
}

TEST(LabelViews, AFrameThatIsNotUsableIsNeverSegmented) {
  Frames frames({0, 0});
  const std::vector<Labelled> labelled = frames.Label({kAutoTurns, kAutoTurns}, 0);
  EXPECT_TRUE(frames.Tried(0).empty());
  EXPECT_FALSE(labelled[0].initial.found);
  EXPECT_EQ(labelled[0].segmentation.labels, LabelImage(320, 288));
  EXPECT_TRUE(labelled[1].initial.found);
}

}  // namespace
}  // namespace volalign::orientation_test

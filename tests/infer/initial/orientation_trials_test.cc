// Which views are tried in which orientations is seen through LabelViews (orientation_test.cc);
// here, what a trial has to show.

#include "infer/initial/orientation_trials.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "core/base/odds.h"
#include "infer/initial/floor.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::pose_internal::orientation_trials_test {
namespace {

using testing_infer::Certain;
using testing_infer::Kinect;
using testing_infer::Render;
using testing_infer::RingPose;

OrientationTrial Trial(double by_view, double by_floor, bool found = true) {
  OrientationTrial trial;
  trial.initial.found = found;
  trial.by_view = by_view;
  trial.by_floor = by_floor;
  return trial;
}

TEST(OrientationTrial, IsSettledByViewAndFloor) {
  const double decisive = std::log(kDecisiveOdds), less = decisive - 0.01;
  EXPECT_TRUE(Settled(Trial(decisive, decisive)));
  EXPECT_FALSE(Settled(Trial(less, 20)));
  EXPECT_FALSE(Settled(Trial(20, less)));
  EXPECT_FALSE(Settled(Trial(20, 20, false)));
}

std::size_t Best(std::vector<OrientationTrial> trials) {
  std::vector<OrientationTrial*> pointers;
  for (OrientationTrial& trial : trials) pointers.push_back(&trial);
  return static_cast<std::size_t>(BestTrial(pointers) - trials.data());
}

TEST(BestTrial, IsTheOneForWhichMostSpeaks) {
  EXPECT_EQ(Best({Trial(4, 20), Trial(5, 5), Trial(3, 15)}), 1u) << "a settled one";
  EXPECT_EQ(Best({Trial(4, 0.1), Trial(3, 2), Trial(-4, 5)}), 1u);
  EXPECT_EQ(Best({Trial(9, 9, false), Trial(-10, -10)}), 1u) << "one that has a pose";
  EXPECT_EQ(Best({Trial(2, 0, false)}), 0u);
}

/// Right in one orientation of each view, else nothing.
class OneOrientation : public Segmenter {
 public:
  using Segmenter::Segment;
  std::vector<SegmentationResult> Segment(
      const std::vector<SegmentationRequest>& requests) override {
    std::vector<SegmentationResult> results;
    for (const SegmentationRequest& request : requests) {
      const auto& [turns, labels] = right.at(request.depth);
      results.push_back(Certain(
          request.quarter_turns == turns ? labels : LabelImage(labels.width(), labels.height())));
    }
    return results;
  }
  std::map<const DepthImage*, std::pair<int, LabelImage>> right;
};

TEST(TryOrientations, GivesPoseAndFloorOfEachTrial) {
  const Structure structure = testing_infer::PaperStructure();
  const Intrinsics intrinsics = Kinect();
  const Pose truth = RingPose(40);
  const auto rendered = Render(structure, intrinsics, truth, {true, 3.5});
  const std::vector<SensorView> images(2, MakeSensorView(rendered.depth, intrinsics));
  OneOrientation segmenter;
  for (const SensorView& view : images) segmenter.right[&view.depth] = {2, rendered.labels};
  // The second one's turns are given, wrongly, and are not doubted; a third is not usable.
  const std::vector<LabelRequest> views = {{&images[0], &intrinsics, kAutoTurns, true},
                                           {&images[1], &intrinsics, 1, true},
                                           {&images[0], &intrinsics, kAutoTurns, false}};
  const InitialPoseOptions initial;
  const OrientationOptions options;
  StageClock clock;
  const LabelContext context{views, structure, FindAliases(structure), &segmenter, initial, options,
                             1,     &clock};
  const std::vector<OrientationTrial> trials = TryOrientations(context);
  std::vector<std::pair<std::size_t, int>> tried;
  for (const OrientationTrial& trial : trials) tried.emplace_back(trial.view, trial.turns);
  EXPECT_EQ(tried,
            (std::vector<std::pair<std::size_t, int>>{{0, 0}, {1, 1}, {0, 1}, {0, 2}, {0, 3}}));
  for (const OrientationTrial& trial : trials) {
    const bool right = trial.view == 0 && trial.turns == 2;
    EXPECT_EQ(trial.initial.found, right);
    EXPECT_EQ(Settled(trial), right);
    if (!right) continue;
    const PoseError error = ComparePoses(trial.initial.structure_from_sensor, truth);
    EXPECT_LT(error.translation_m, 0.01);
    EXPECT_LT(error.rotation_deg, 0.3);
    EXPECT_EQ(trial.segmentation.labels, rendered.labels);
    EXPECT_EQ(trial.by_floor, FloorMargin(images[0], structure, context.aliases,
                                          trial.initial.structure_from_sensor));
  }
}

}  // namespace
}  // namespace volalign::pose_internal::orientation_trials_test

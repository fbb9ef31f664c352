// Which views are tried in which orientations is seen through LabelViews (orientation_test.cc);
// here, what a trial has to show.

#include "infer/initial/orientation_trials.h"

#include <gtest/gtest.h>

#include <map>
#include <utility>
#include <vector>

#include "infer/initial/floor.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::pose_internal::orientation_trials_test {
namespace {

using testing_infer::Certain;
using testing_infer::Kinect;
using testing_infer::Render;
using testing_infer::RingPose;

/// With an agreement of `hundredths` of a hundred pixels.
OrientationTrial Trial(int hundredths, double floor_margin, bool found = true) {
  OrientationTrial trial;
  trial.initial.found = found;
  trial.initial.agreement.same_label = hundredths;
  trial.initial.agreement.either = 100;
  trial.floor_margin = floor_margin;
  return trial;
}

OrientationOptions Options() {
  OrientationOptions options;
  options.decided_score = 0.6;
  options.good_score = 0.85;
  options.choice.floor_margin = 0.05;
  options.choice.rival_score = 0.5;
  return options;
}

TEST(OrientationTrial, IsDecidedByLabelsAndFloor) {
  struct Case {
    OrientationTrial trial;
    bool decided, settled;
  };
  const Case cases[] = {{Trial(60, 0.05), true, false},        {Trial(59, 0.05), false, false},
                        {Trial(60, 0.049), false, false},      {Trial(85, 0.05), true, true},
                        {Trial(84, 0.3), true, false},         {Trial(95, 0.049), false, false},
                        {Trial(95, 0.3, false), false, false}, {Trial(95, -0.2), false, false}};
  for (const Case& c : cases) {
    EXPECT_EQ(Decided(c.trial, Options()), c.decided) << c.trial.score();
    EXPECT_EQ(Settled(c.trial, Options()), c.settled) << c.trial.score();
  }
  EXPECT_EQ(Trial(95, 0.3, false).score(), 0) << "no pose agrees with nothing";
}

std::size_t Best(std::vector<OrientationTrial> trials) {
  std::vector<OrientationTrial*> pointers;
  for (OrientationTrial& trial : trials) pointers.push_back(&trial);
  return static_cast<std::size_t>(BestTrial(pointers, Options()) - trials.data());
}

TEST(BestTrial, StandsOnTheFloorAmongThoseThatFit) {
  // A settled one before all others, whatever their floor.
  EXPECT_EQ(Best({Trial(84, 0.9), Trial(85, 0.05), Trial(70, 0.5)}), 1u);
  // Without one, of those with half of the best score the one with the clearest floor.
  EXPECT_EQ(Best({Trial(80, 0.01), Trial(41, 0.2), Trial(39, 0.9)}), 1u);
  EXPECT_EQ(Best({Trial(80, 0.01), Trial(39, 0.2), Trial(10, 0.9)}), 0u);
  // Where the floor says nothing, the labels.
  EXPECT_EQ(Best({Trial(50, 0), Trial(55, 0), Trial(52, 0)}), 1u);
  // One that has no pose counts for nothing.
  EXPECT_EQ(Best({Trial(95, 0.9, false), Trial(20, -0.1)}), 1u);
  EXPECT_EQ(Best({Trial(20, 0, false)}), 0u);
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
    EXPECT_EQ(Decided(trial, options), right);
    if (!right) continue;
    const PoseError error = ComparePoses(trial.initial.structure_from_sensor, truth);
    EXPECT_LT(error.translation_m, 0.01);
    EXPECT_LT(error.rotation_deg, 0.3);
    EXPECT_EQ(trial.segmentation.labels, rendered.labels);
    EXPECT_EQ(trial.floor_margin, FloorMargin(images[0], structure, context.aliases,
                                              trial.initial.structure_from_sensor));
  }
}

}  // namespace
}  // namespace volalign::pose_internal::orientation_trials_test

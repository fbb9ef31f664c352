#include "infer/initial/pose_choice.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/visibility.h"
#include "infer/calib/calibrate.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::pose_choice_test {
namespace {

using testing_infer::Certain;
using testing_infer::PaperStructure;
using testing_infer::Rig;
using testing_infer::RingPose;
using testing_infer::Scene;
using testing_infer::StoredSegmenter;

PoseCandidate Competitor(const Pose& pose, double floor, double network_score,
                         double label_score = 0) {
  PoseCandidate evidence;
  evidence.structure_from_sensor = pose;
  evidence.floor = floor;
  evidence.network_score = network_score;
  evidence.label_score = label_score;
  return evidence;
}

Pose Upright(double yaw_deg, double height) {
  Pose pose = Pose::Identity();
  pose.linear() =
      Eigen::AngleAxisd(yaw_deg * M_PI / 180, Eigen::Vector3d::UnitY()).toRotationMatrix();
  pose.translation().y() = height;
  return pose;
}

Pose UpsideDown() {
  Pose pose = Pose::Identity();
  pose.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  return pose;
}

PoseChoice DecideAmong(const std::vector<PoseCandidate>& poses) {
  return Decide(poses, PaperStructure(), PoseChoiceOptions());
}

TEST(ListCompetitors, TakesTrialsThatFitHalfAsWellAsTheBestAndTheirAliases) {
  const auto initial = [](bool found, int same_label, double height) {
    InitialPose pose;
    pose.found = found;
    pose.agreement.same_label = same_label;
    pose.agreement.either = 100;
    pose.structure_from_sensor = Upright(0, height);
    return pose;
  };
  const InitialPose good = initial(true, 80, 1), half = initial(true, 40, 2),
                    bad = initial(true, 39, 3), none = initial(false, 90, 4);
  const SegmentationResult labels;
  const std::vector<PoseTrial> trials = {
      {&labels, &bad}, {&labels, &half}, {&labels, &none}, {&labels, &good}};
  std::vector<StructureAlias> aliases(2);
  aliases[0].motion = UpsideDown();
  aliases[1].motion = Upright(90, 0.4);
  const std::vector<PoseCandidate> all = ListCompetitors(trials, aliases, false, {});
  const std::vector<std::pair<std::size_t, int>> expected = {{1, -1}, {1, 0}, {1, 1},
                                                             {3, -1}, {3, 0}, {3, 1}};
  ASSERT_EQ(all.size(), expected.size());
  for (std::size_t k = 0; k < all.size(); ++k) {
    EXPECT_EQ(all[k].trial, expected[k].first) << k;
    EXPECT_EQ(all[k].alias, expected[k].second) << k;
  }
  EXPECT_NEAR(all[0].structure_from_sensor.translation().y(), 2, 1e-12);
  EXPECT_NEAR(all[1].structure_from_sensor.translation().y(), -2, 1e-12);
  EXPECT_NEAR(all[2].structure_from_sensor.translation().y(), 2.4, 1e-12);

  const std::vector<PoseCandidate> upright = ListCompetitors(trials, aliases, true, {});
  ASSERT_EQ(upright.size(), 4u);
  for (const PoseCandidate& pose : upright) EXPECT_NE(pose.alias, 0);
  EXPECT_TRUE(ListCompetitors({{&labels, &none}}, aliases, false, {}).empty());
}

TEST(DropMisfits, KeepsPosesAboutAsGoodAsTheBest) {
  std::vector<PoseCandidate> poses(4);
  poses[0].shape_iou = 0.5;
  poses[1].shape_iou = 0.75;
  poses[2].shape_iou = 0.62;
  poses[3].shape_iou = 0.66;
  DropMisfits(0.1, &poses);
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_EQ(poses[0].shape_iou, 0.75);
  EXPECT_EQ(poses[1].shape_iou, 0.66);
  std::vector<PoseCandidate> none;
  DropMisfits(0.1, &none);
  EXPECT_TRUE(none.empty());
}

TEST(Decide, NothingAmongNothing) {
  const PoseChoice choice = DecideAmong({});
  EXPECT_FALSE(choice.found);
  EXPECT_FALSE(choice.ambiguous);
}

TEST(Decide, TheFloorGoesBeforeTheLabels) {
  const PoseChoice choice =
      DecideAmong({Competitor(Upright(0, 0), 0.2, 0.4), Competitor(Upright(90, 0.4), 0.14, 0.9)});
  ASSERT_TRUE(choice.found);
  EXPECT_EQ(choice.best.network_score, 0.4);
  EXPECT_FALSE(choice.ambiguous);
}

TEST(Decide, LabelsTellOneStepOfASpiralFromTheNextWhereTheyAreClear) {
  const PoseCandidate low = Competitor(Upright(0, 0), 0.2, 0.5);
  for (const double score : {0.69, 0.71}) {
    const PoseChoice choice = DecideAmong({low, Competitor(Upright(90, 0.4), 0.16, score)});
    EXPECT_EQ(choice.best.network_score, score);
    EXPECT_EQ(choice.ambiguous, score < 0.7) << score;
    if (choice.ambiguous) {
      EXPECT_EQ(choice.rival.network_score, 0.5);
    }
  }
}

TEST(Decide, LabelsDoNotTellUpFromDown) {
  const PoseChoice choice =
      DecideAmong({Competitor(Upright(0, 0), 0.0, 0.9), Competitor(UpsideDown(), 0.0, 0.1)});
  EXPECT_EQ(choice.best.network_score, 0.9);
  EXPECT_TRUE(choice.ambiguous);
  EXPECT_EQ(choice.rival.network_score, 0.1);
  // A floor does.
  EXPECT_FALSE(
      DecideAmong({Competitor(Upright(0, 0), 0.1, 0.9), Competitor(UpsideDown(), 0.0, 0.1)})
          .ambiguous);
}

TEST(Decide, TheRivalIsTheBestOfSeveral) {
  const PoseChoice choice =
      DecideAmong({Competitor(Upright(0, 0), 0, 0.8), Competitor(Upright(90, 0.4), 0, 0.65),
                   Competitor(Upright(180, 0.8), 0, 0.75), Competitor(Upright(-90, -0.4), 0, 0.7)});
  EXPECT_TRUE(choice.ambiguous);
  EXPECT_EQ(choice.rival.network_score, 0.75);
}

// Poses 10 cm and 5 deg apart are one pose that different labels led to.
TEST(Decide, TakesTheLabelsThatSuitThePoseBest) {
  PoseCandidate first = Competitor(Upright(0, 0), 0, 0.8, 0.3);
  PoseCandidate second = Competitor(Upright(5, 0.1), 0, 0.6, 0.9);
  first.trial = 0;
  second.trial = 1;
  second.alias = 2;
  const PoseChoice choice = DecideAmong({first, second});
  EXPECT_FALSE(choice.ambiguous);
  EXPECT_EQ(choice.best.trial, 1u);
  EXPECT_EQ(choice.best.alias, 2);
  EXPECT_EQ(choice.best.label_score, 0.9);
  EXPECT_EQ(choice.best.network_score, 0.8);
}

/// A wide picture that cuts the stack off at the top and the bottom.
Intrinsics Wide() {
  Intrinsics intrinsics;
  intrinsics.width = 320;
  intrinsics.height = 180;
  intrinsics.fx = intrinsics.fy = 230;
  intrinsics.cx = 159.5;
  intrinsics.cy = 89.5;
  return intrinsics;
}

Pose WidePose(double phi_deg) {
  return RingPose(phi_deg, 1.65, 0, 0, Eigen::Vector3d(-0.05, -0.1, 0));
}

/// Labels that a network gives that takes the structure for the alias: those of the structure as
/// seen from the moved pose, where the depths are the same.
LabelImage LabelsAs(const Rig& rig, const Pose& motion) {
  const SensorFrame& frame = rig.frames.back();
  LabelImage labels =
      CastView(rig.structure, ComputeRays(frame.intrinsics), motion * *frame.ground_truth).labels;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (rig.labels.back()[i] == 0) labels[i] = 0;
  }
  return labels;
}

FrameResult CalibrateAs(const Rig& rig, const LabelImage& labels) {
  StoredSegmenter segmenter;
  segmenter.Store(rig.frames.back().depth, Certain(labels));
  CalibrateOptions options;
  return Calibrate(rig.frames, rig.structure, segmenter, options).sensors.front();
}

Rig WideRig(double phi_deg, int turns, const Scene& scene = {true, 3.0}) {
  Rig rig{PaperStructure(), {}, {}};
  rig.Add("S", WidePose(phi_deg), scene, Wide());
  rig.frames.back().quarter_turns = turns;
  return rig;
}

/// Without a floor, before walls of which only a band about the stack's middle is measured, so that
/// the frame is much the same upside down.
Rig BetweenWalls(int turns) {
  Rig rig = WideRig(20, turns, {false, 3.0});
  SensorFrame& frame = rig.frames.back();
  const SensorView view = MakeSensorView(frame.depth, frame.intrinsics);
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const Eigen::Vector3d p = *frame.ground_truth * view.Point(u, v);
      if (rig.labels.back()(u, v) == 0 && std::abs(p.y()) > 0.5) frame.depth(u, v) = 0;
    }
  }
  return rig;
}

// Rendered ground truth: the pose that the frame was cast from.
TEST(CompetingPoses, TheFloorRightsWhatTheNetworkTookForAnAlias) {
  for (const double phi : {20.0, 250.0}) {
    const Rig rig = WideRig(phi, kAutoTurns);
    const std::vector<StructureAlias> aliases = FindAliases(rig.structure);
    for (std::size_t a = 0; a < aliases.size() && aliases[a].boxes >= 3; ++a) {
      const FrameResult sensor = CalibrateAs(rig, LabelsAs(rig, aliases[a].motion));
      ASSERT_TRUE(sensor.structure_from_sensor.has_value())
          << phi << " " << a << ": " << ToString(sensor.code) << ", " << sensor.reason;
      EXPECT_LT(sensor.error->translation_m, 0.02) << phi << " " << a;
      EXPECT_LT(sensor.error->rotation_deg, 1) << phi << " " << a;
      EXPECT_NE(sensor.code, SensorCode::kAmbiguous) << phi << " " << a;
      EXPECT_GT(sensor.label_iou, 0.6) << phi << " " << a;
    }
  }
}

TEST(CompetingPoses, AMixtureOfBoxesIsReconciled) {
  const Rig rig = WideRig(20, kAutoTurns);
  const std::vector<StructureAlias> aliases = FindAliases(rig.structure);
  LabelImage labels = LabelsAs(rig, aliases[0].motion);
  for (std::size_t a = 0; a < aliases.size(); ++a) {
    if (aliases[a].boxes != 3 || !aliases[a].keeps_up()) continue;
    const LabelImage others = LabelsAs(rig, aliases[a].motion);
    for (int v = 0; v < labels.height() / 2; ++v) {
      for (int u = 0; u < labels.width(); ++u) labels(u, v) = others(u, v);
    }
    const FrameResult sensor = CalibrateAs(rig, labels);
    ASSERT_TRUE(sensor.structure_from_sensor.has_value())
        << ToString(sensor.code) << ", " << sensor.reason;
    EXPECT_EQ(sensor.status, SensorStatus::kOk) << ToString(sensor.code);
    EXPECT_LT(sensor.error->translation_m, 0.02);
    EXPECT_GT(sensor.label_iou, 0.8);
  }
}

// No floor: the frame is the same, to 5 mm, from both poses, and no answer is `ok`.
TEST(CompetingPoses, WithoutAFloorUpAndDownStayOpen) {
  for (const bool over : {false, true}) {
    const Rig rig = BetweenWalls(kAutoTurns);
    const Pose motion = over ? FindAliases(rig.structure).front().motion : Pose::Identity();
    const FrameResult sensor = CalibrateAs(rig, LabelsAs(rig, motion));
    ASSERT_TRUE(sensor.structure_from_sensor.has_value())
        << ToString(sensor.code) << ", " << sensor.reason;
    EXPECT_EQ(sensor.status, SensorStatus::kWeak);
    EXPECT_EQ(sensor.code, SensorCode::kAmbiguous);
    EXPECT_NE(sensor.reason.find("upside down"), std::string::npos) << sensor.reason;
    EXPECT_NE(sensor.hint.find("quarter_turns"), std::string::npos) << sensor.hint;
  }
  const Rig given = BetweenWalls(3);
  const FrameResult sensor = CalibrateAs(given, given.labels.back());
  EXPECT_EQ(sensor.status, SensorStatus::kOk) << ToString(sensor.code) << ", " << sensor.reason;
}

}  // namespace
}  // namespace volalign::pose_choice_test

#include "infer/calib/judge.h"

#include <gtest/gtest.h>

#include <functional>
#include <optional>
#include <vector>

#include "infer/calib/calibrate.h"
#include "infer/calib/result.h"
#include "infer/initial/pose_hypotheses.h"
#include "infer/initial/symmetries.h"
#include "tests/core/base/expect_error.h"
#include "tests/infer/checks/seen_with_labels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::judge_test {
namespace {

using namespace testing_infer;

/// Three sensors around the paper's stack, so many degrees apart.
Rig ThreeApart(double apart_deg) {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 3; ++i) rig.Add(RingPose(40 + apart_deg * i));
  return rig;
}

/// S0 and S2 are located, S1 is not; refined poses are as given.
struct Stages {
  Rig rig;
  CaptureSet capture;
  CalibrateOptions options;
  Joint joint;

  static const Rig& TheRig() {
    static const Rig rig = ThreeApart(60);
    return rig;
  }
  Stages() : rig(TheRig()), capture({{"", rig.frames}}, rig.structure) {
    joint.seen = SeenWithLabels(capture, rig.labels);
    joint.stacks.push_back({Pose::Identity(), Matrix6d::Zero(), {}, rig.structure});
    joint.lenses.resize(3);
    joint.located = MapFrames(joint.seen.views, 1, [&](FrameId id) -> LocateResult {
      if (id.frame == 1) return Finding{SensorCode::kNoStructure, "reason", "hint"};
      joint.frames[id].settled = true;
      RefinedFrame& refined = joint.frames[id].refined;
      refined.solved = true;
      refined.structure_from_sensor = *rig.frames[id.frame].ground_truth;
      refined.covariance = 1e-6 * Matrix6d::Identity();
      LocatedFrame located;
      located.own_pose = refined.structure_from_sensor;
      return located;
    });
    joint.pairs = {{{"S0", "S2", 0.25, 0.003}}};
  }
  RefinedFrame& Refined(std::size_t frame) { return joint.frames.at({0, frame}).refined; }
  CalibrationResult Judge() {
    const auto suspect_lenses =
        MapFrames(joint.located, 1, [](FrameId) { return std::optional<Finding>(); });
    return volalign::Judge(joint, {std::nullopt}, suspect_lenses, options);
  }
};

TEST(Judge, EverySensorGetsWhatIsItsOwn) {
  const CalibrationResult result = Stages().Judge();
  ASSERT_EQ(result.sensors.size(), 3u);
  EXPECT_EQ(result.sensors[0].status, SensorStatus::kOk) << result.sensors[0].reason;
  EXPECT_EQ(result.sensors[1].status, SensorStatus::kFailed);
  EXPECT_EQ(result.sensors[1].code, SensorCode::kNoStructure);
  EXPECT_FALSE(result.sensors[1].structure_from_sensor.has_value());
  EXPECT_EQ(result.sensors[2].status, SensorStatus::kOk) << result.sensors[2].reason;
  EXPECT_NEAR(result.sensors[2].error->translation_m, 0, 1e-9);
  ASSERT_EQ(result.pairs.size(), 1u);
  EXPECT_EQ(result.pairs[0].a, "S0");
  EXPECT_EQ(result.pairs[0].b, "S2");
  EXPECT_EQ(result.placed(), 2);
  EXPECT_EQ(result.verdict(), SensorStatus::kFailed);
}

TEST(Judge, ASensorThatCouldNotBeSolvedIsWeak) {
  Stages stages;
  stages.Refined(2).solved = false;
  stages.Refined(2).problem = "its solution is no number";
  const CalibrationResult result = stages.Judge();
  EXPECT_EQ(result.sensors[0].status, SensorStatus::kOk) << result.sensors[0].reason;
  EXPECT_EQ(result.sensors[2].status, SensorStatus::kWeak);
  EXPECT_EQ(result.sensors[2].code, SensorCode::kUnsolved);
  EXPECT_EQ(result.sensors[2].reason, "its solution is no number");
}

TEST(Judge, NoSensorIsBelievedWhereMostOthersDoNotFindTheStack) {
  Stages stages;
  CalibrationResult result = stages.Judge();
  EXPECT_EQ(result.sensors[0].status, SensorStatus::kOk) << result.sensors[0].reason;
  ASSERT_TRUE(result.assembly.has_value());
  EXPECT_EQ(result.assembly->arrangement.sentence, "the boxes stand as described");
  stages.joint.located[{0, 2}] = Finding{SensorCode::kInconsistent, "reason", "hint"};
  stages.joint.frames.erase({0, 2});
  stages.joint.pairs = {{}};
  result = stages.Judge();
  EXPECT_EQ(result.sensors[0].status, SensorStatus::kWeak);
  EXPECT_EQ(result.sensors[0].code, SensorCode::kAmbiguous);
  EXPECT_EQ(result.sensors[0].reason.rfind("2 of 2 other sensors did not find the stack", 0), 0u);
  EXPECT_EQ(result.assembly->arrangement.sentence,
            "not known whether the boxes stand as described: 0 of 3 sensors show it");
  // That one has no depth says nothing of the stack.
  stages.joint.located[{0, 1}] = Finding{SensorCode::kNoDepth, "reason", "hint"};
  EXPECT_EQ(stages.Judge().sensors[0].status, SensorStatus::kOk);
}

TEST(QuestionsStack, WhereASensorContradictsOthersAtTheOnlyPoseThatItHas) {
  SensorOutcome sensor;
  sensor.name = "S0";
  for (const SensorCode code : {SensorCode::kNoStructure, SensorCode::kDisagrees,
                                SensorCode::kLargeResidual, SensorCode::kAmbiguous}) {
    sensor.code = code;
    EXPECT_TRUE(QuestionsStack(sensor, {}));
  }
  RigAlternative alternative;
  alternative.sensors = {{"S0", 2, Pose::Identity()}};
  EXPECT_FALSE(QuestionsStack(sensor, {alternative}));
  for (const SensorCode code : {SensorCode::kNone, SensorCode::kNoDepth, SensorCode::kUncertain}) {
    sensor.code = code;
    EXPECT_FALSE(QuestionsStack(sensor, {}));
  }
}

TEST(Judge, WhatIsImprobableIsNoAlternative) {
  for (const double log_odds : {13.0, 14.0}) {
    Stages stages;
    stages.joint.seen.labelled[{0, 0}].alternatives = {{0, 2, log_odds, Pose::Identity()}};
    EXPECT_EQ(stages.Judge().alternatives.size(), log_odds > std::log(kNamedOdds) ? 0u : 1u);
  }
}

TEST(Judge, NoSensorThatHasNotSettledIsOk) {
  Stages stages;
  stages.joint.report = {7, false, true, 0.0034, 2.5};
  stages.joint.frames.at({0, 0}).settled = false;
  stages.joint.frames.at({0, 0}).moved_m = 0.0034;
  const CalibrationResult result = stages.Judge();
  EXPECT_EQ(result.solve.rounds, 7);
  EXPECT_EQ(result.sensors[0].status, SensorStatus::kWeak);
  EXPECT_EQ(result.sensors[0].code, SensorCode::kUnsettled);
  EXPECT_TRUE(Has(result.sensors[0].reason, "3.4 mm"));
  EXPECT_FALSE(Has(result.sensors[0].reason, "steps"));
  EXPECT_EQ(result.sensors[1].code, SensorCode::kNoStructure);
  EXPECT_EQ(result.sensors[2].status, SensorStatus::kOk) << result.sensors[2].reason;
  stages.joint.report = {7, false, false, 0.0001, 0};
  EXPECT_TRUE(Has(stages.Judge().sensors[0].reason, "steps"));
}

TEST(Judge, FiguresAreOfTheReportedPoseNotOfTheOwnOne) {
  Stages stages;
  Pose& refined = stages.Refined(2).structure_from_sensor;
  refined.translation().y() += 0.1;
  const SensorView view = stages.joint.seen.views[{0, 2}];
  const ExpectedView seen = CastView(stages.rig.structure, view.rays, refined);
  MiouOptions options;
  options.num_classes = stages.rig.structure.num_classes();
  const double miou = MeanIou(stages.rig.labels[2], seen.labels, view.depth, options);
  ASSERT_LT(miou, 0.95);
  const std::size_t found = stages.joint.seen.labelled[{0, 2}].initial.patches.size();
  const CalibrationResult result = stages.Judge();
  EXPECT_NEAR(result.sensors[0].miou, 1, 1e-9);
  EXPECT_NEAR(result.sensors[2].miou, miou, 1e-12);
  EXPECT_LT(result.sensors[2].label_iou, 0.95);
  EXPECT_LT(result.sensors[2].explained_share, 0.99);
  EXPECT_LT(result.sensors[2].sides.size(), found);
}

TEST(Judge, APoseIsWeakByWhatIsItsOwn) {
  const auto code = [](const std::function<void(Stages*)>& spoil) {
    Stages stages;
    spoil(&stages);
    const FrameResult sensor = stages.Judge().sensors[2];
    EXPECT_EQ(sensor.status, SensorStatus::kWeak) << sensor.reason;
    return sensor.code;
  };
  EXPECT_EQ(code([](Stages* stages) { stages->Refined(2).covariance *= 1000; }),
            SensorCode::kUncertain);
  EXPECT_EQ(code([](Stages* stages) {
              stages->joint.located[{0, 1}] = Finding{SensorCode::kNoDepth, "", ""};
              DepthImage& depth = stages->joint.seen.views[{0, 2}].depth;
              for (std::size_t i = 0; i < depth.size(); i += 4) depth[i] *= 1.1F;
            }),
            SensorCode::kFewInliers);
  EXPECT_EQ(
      code([](Stages* stages) { stages->capture.captures[0].frames[2].typical_intrinsics = true; }),
      SensorCode::kTypicalIntrinsics);
  EXPECT_EQ(code([](Stages* stages) {
              stages->joint.seen.depths[{0, 2}].same_depth_as = "S1";
            }),
            SensorCode::kDuplicateDepth);
}

TEST(Judge, WhereAFloorWouldDecideUnknownTurnsAreAskedFor) {
  Stages stages;
  stages.joint.seen.labelled[{0, 2}].other_pose = "upside down";
  stages.joint.seen.labelled[{0, 2}].floor_would_tell = true;
  for (const int turns : {kAutoTurns, 0}) {
    stages.capture.captures[0].frames[2].quarter_turns = turns;
    const FrameResult sensor = stages.Judge().sensors[2];
    EXPECT_EQ(sensor.code, SensorCode::kAmbiguous);
    EXPECT_TRUE(Has(sensor.reason, "upside down", "shows no floor"));
    EXPECT_EQ(bool(Has(sensor.hint, "give its quarter_turns")), turns == kAutoTurns);
  }
}

TEST(Judge, DepthsAreJudgedAsTheyWereCorrected) {
  // What the sensor measured is 2 % and 30 mm short, as was found out.
  Stages stages;
  RefinedFrame& refined = stages.Refined(2);
  refined.depth_gain = 1 / 0.98;
  refined.depth_offset = 0.03;
  for (float& z : stages.joint.seen.views[{0, 2}].depth) {
    if (z > 0) z = 0.98f * (z - 0.03f);
  }
  const CalibrationResult result = stages.Judge();
  EXPECT_GT(result.sensors[2].initial_rms_to_structure_m, 0.01) << "as measured";
  EXPECT_LT(result.sensors[2].rms_to_structure_m, 1e-4);
  EXPECT_NEAR(result.sensors[2].inlier_share, 1, 1e-9);
  EXPECT_EQ(result.sensors[2].depth_gain, 1 / 0.98);
  EXPECT_EQ(result.sensors[2].depth_offset_m, 0.03);
  EXPECT_EQ(result.sensors[2].status, SensorStatus::kOk) << result.sensors[2].reason;
  ASSERT_TRUE(result.metrics.has_value());
  EXPECT_NEAR(result.metrics->d1, Stages().Judge().metrics->d1, 1e-4);
}

TEST(Judge, ReportedPosesAreJudgedByTheBoxesAsBuiltInitialOnesByTheDescribedOnes) {
  Stages stages;
  Pose aside = Pose::Identity();
  aside.translation().x() = 0.015;
  stages.joint.stacks.front().built =
      stages.rig.structure.Displaced(std::vector<Pose>(4, aside), 1);
  const CalibrationResult result = stages.Judge();
  // Sides that look along x are 15 mm off, the others by what of them is not above another.
  EXPECT_GT(result.sensors[0].rms_to_structure_m, 0.004);
  EXPECT_LT(result.sensors[0].rms_to_structure_m, 0.015);
  EXPECT_LT(result.sensors[0].initial_rms_to_structure_m, 0.002);
}

TEST(Judge, ALensThatWasEstimatedIsCalledSo) {
  for (const bool estimated : {true, false}) {
    Stages stages;
    RefinedLens& lens = stages.joint.lenses[stages.joint.seen.lenses.of_frame[{0, 2}]];
    lens.estimated = estimated;
    lens.sigmas = {0.001, 0.002, 0.003};
    const CalibrationResult result = stages.Judge();
    EXPECT_EQ(result.sensors[2].lens.source,
              estimated ? LensSource::kEstimated : LensSource::kGiven);
    EXPECT_EQ(result.sensors[2].lens.sigmas, Eigen::Vector3d(0.001, 0.002, 0.003));
  }
}

TEST(Judge, ASensorThatDisagreesNamesTheOthersAndWhereTheyWouldHaveIt) {
  Stages stages;
  RefusedFit& fit = stages.Refined(2).refused_fit.emplace();
  fit.structure_from_sensor = RingPose(100);
  fit.built = stages.rig.structure;
  stages.joint.frames.at({0, 2}).contradicts = {{0, 0}};
  const FrameResult sensor = stages.Judge().sensors[2];
  EXPECT_EQ(sensor.status, SensorStatus::kWeak);
  EXPECT_EQ(sensor.code, SensorCode::kDisagrees);
  ASSERT_TRUE(sensor.together.has_value());
  EXPECT_TRUE(sensor.together->isApprox(RingPose(100)));
  EXPECT_EQ(sensor.disagrees_with, std::vector<std::string>{"S0"});
}

TEST(Judge, SensorsInOnePlaceNameEachOther) {
  Stages stages;
  stages.Refined(2).structure_from_sensor = stages.Refined(0).structure_from_sensor;
  const CalibrationResult result = stages.Judge();
  for (const std::size_t i : {std::size_t{0}, std::size_t{2}}) {
    EXPECT_EQ(result.sensors[i].status, SensorStatus::kWeak);
    EXPECT_EQ(result.sensors[i].code, SensorCode::kSamePose);
  }
  EXPECT_TRUE(Has(result.sensors[0].reason, "where S2 stands"));
}

}  // namespace
}  // namespace volalign::judge_test

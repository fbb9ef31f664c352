#include "infer/judge.h"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "infer/calibrate.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::Certain;
using testing_infer::Rig;
using testing_infer::RingPose;

/// S0 and S2 are placed, S1 is not; refined poses are as given.
struct Stages {
  Rig rig{testing_infer::PaperStructure(), {}, {}};
  CalibrateOptions options;
  StageResults results;

  Stages() {
    for (int i = 0; i < 3; ++i) rig.Add("S" + std::to_string(i), RingPose(40 + 60 * i));
    results.views = MakeSensorViews(rig.frames, 1);
    results.depths.resize(3);
    results.refined.placements.push_back({Pose::Identity(), Matrix6d::Zero(), {}, rig.structure});
    results.lenses = GivenLenses(rig.frames);
    results.refined.lenses.resize(3);
    results.suspect_lenses.resize(3);
    for (std::size_t i = 0; i < 3; ++i) {
      LabelledView view;
      view.segmentation = Certain(rig.labels[i]);
      view.initial =
          EstimateInitialPose(results.views[i], view.segmentation, rig.structure, options.initial);
      if (i == 1) {
        results.placements.emplace_back(Finding{SensorCode::kNoStructure, "reason", "hint"});
      } else {
        results.placements.emplace_back(
            PlacedSensor{*rig.frames[i].ground_truth,
                         SamplePoints(results.views[i], view.segmentation, rig.structure, {}),
                         std::nullopt, std::nullopt});
        RefinedFrame refined;
        refined.accepted = true;
        refined.structure_from_sensor = *rig.frames[i].ground_truth;
        refined.covariance = 1e-6 * Matrix6d::Identity();
        results.refined.frames.push_back(refined);
      }
      results.labelled.push_back(std::move(view));
    }
    results.refined.pairs.push_back({0, 1, 0.25, 0.003});
  }
  CalibrationResult Judge() {
    return JudgeSensors(rig.frames, rig.structure, std::move(results),
                        {options.verdict, options.initial.evidence.min_confidence, 1});
  }
};

TEST(JudgeSensors, EverySensorGetsWhatIsItsOwn) {
  const CalibrationResult result = Stages().Judge();
  ASSERT_EQ(result.sensors.size(), 3u);
  EXPECT_EQ(result.sensors[0].status, SensorStatus::kOk) << result.sensors[0].reason;
  EXPECT_EQ(result.sensors[1].status, SensorStatus::kFailed);
  EXPECT_EQ(result.sensors[1].code, SensorCode::kNoStructure);
  EXPECT_FALSE(result.sensors[1].structure_from_sensor.has_value());
  EXPECT_EQ(result.sensors[2].status, SensorStatus::kOk) << result.sensors[2].reason;
  EXPECT_NEAR(result.sensors[2].error->translation_m, 0, 1e-9);
  // Pairs count placed sensors only: the second of those is S2.
  ASSERT_EQ(result.pairs.size(), 1u);
  EXPECT_EQ(result.pairs[0].a, "S0");
  EXPECT_EQ(result.pairs[0].b, "S2");
  EXPECT_EQ(result.placed(), 2);
  EXPECT_EQ(result.verdict(), SensorStatus::kFailed);
}

TEST(JudgeSensors, ASensorThatCouldNotBeSolvedIsWeak) {
  Stages stages;
  stages.results.refined.frames[1].accepted = false;
  stages.results.refined.frames[1].problem = "its solution is no number";
  const CalibrationResult result = stages.Judge();
  EXPECT_EQ(result.sensors[0].status, SensorStatus::kOk) << result.sensors[0].reason;
  EXPECT_EQ(result.sensors[2].status, SensorStatus::kWeak);
  EXPECT_EQ(result.sensors[2].code, SensorCode::kUnsolved);
  EXPECT_EQ(result.sensors[2].reason, "its solution is no number");
}

TEST(JudgeSensors, FiguresAreOfTheReportedPoseNotOfTheOwnOne) {
  Stages stages;
  Pose& refined = stages.results.refined.frames[1].structure_from_sensor;
  refined.translation().y() += 0.1;
  const SensorView view = stages.results.views[2];
  const StructureView seen = CastView(stages.rig.structure, view.rays, refined);
  MiouOptions options;
  options.num_classes = stages.rig.structure.num_classes();
  const double miou = MeanIou(stages.rig.labels[2], seen.labels, view.depth, options);
  ASSERT_LT(miou, 0.95);
  const std::size_t found = stages.results.labelled[2].initial.evidence.size();
  const CalibrationResult result = stages.Judge();
  EXPECT_NEAR(result.sensors[0].miou, 1, 1e-9);
  EXPECT_NEAR(result.sensors[2].miou, miou, 1e-12);
  EXPECT_LT(result.sensors[2].label_iou, 0.95);
  EXPECT_LT(result.sensors[2].explained_share, 0.99);
  EXPECT_LT(result.sensors[2].sides.size(), found);
}

TEST(JudgeSensors, DepthsAreJudgedAsTheyWereCorrected) {
  // What the sensor measured is 2 % and 30 mm short, as was found out.
  Stages stages;
  RefinedFrame& refined = stages.results.refined.frames[1];
  refined.depth_gain = 1 / 0.98;
  refined.depth_offset = 0.03;
  for (float& z : stages.results.views[2].depth) {
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

TEST(JudgeSensors, ReportedPosesAreJudgedByTheBoxesAsBuiltInitialOnesByTheDescribedOnes) {
  Stages stages;
  Pose aside = Pose::Identity();
  aside.translation().x() = 0.015;
  stages.results.refined.placements.front().built =
      stages.rig.structure.Displaced(std::vector<Pose>(4, aside), 1);
  const CalibrationResult result = stages.Judge();
  // Sides that look along x are 15 mm off, the others by what of them is not above another.
  EXPECT_GT(result.sensors[0].rms_to_structure_m, 0.004);
  EXPECT_LT(result.sensors[0].rms_to_structure_m, 0.015);
  EXPECT_LT(result.sensors[0].initial_rms_to_structure_m, 0.002);
}

TEST(JudgeSensors, ALensThatWasEstimatedIsCalledSo) {
  for (const bool estimated : {true, false}) {
    Stages stages;
    const auto lens = static_cast<std::size_t>(stages.results.lenses.of_frame[2]);
    stages.results.refined.lenses[lens].estimated = estimated;
    stages.results.refined.lenses[lens].sigmas = {0.001, 0.002, 0.003};
    const CalibrationResult result = stages.Judge();
    EXPECT_EQ(result.sensors[2].lens.source,
              estimated ? LensSource::kEstimated : LensSource::kGiven);
    EXPECT_EQ(result.sensors[2].lens.sigmas, Eigen::Vector3d(0.001, 0.002, 0.003));
  }
}

TEST(JudgeSensors, SensorsInOnePlaceNameEachOther) {
  Stages stages;
  stages.results.refined.frames[1].structure_from_sensor =
      stages.results.refined.frames[0].structure_from_sensor;
  const CalibrationResult result = stages.Judge();
  for (const std::size_t i : {std::size_t{0}, std::size_t{2}}) {
    EXPECT_EQ(result.sensors[i].status, SensorStatus::kWeak);
    EXPECT_EQ(result.sensors[i].code, SensorCode::kSamePose);
  }
  EXPECT_NE(result.sensors[0].reason.find("where S2 stands"), std::string::npos);
}

}  // namespace
}  // namespace volalign

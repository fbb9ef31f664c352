#include "infer/calib/judge.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "infer/calib/calibrate.h"
#include "infer/calib/check_request.h"
#include "infer/calib/combine_captures.h"
#include "infer/calib/joint_solution.h"
#include "infer/calib/result.h"
#include "infer/initial/pose_hypotheses.h"
#include "infer/initial/symmetries.h"
#include "tests/core/base/expect_error.h"
#include "tests/infer/checks/seen_with_labels.h"
#include "tests/infer/initial/geometry_frames.h"
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
    joint.refined.placements.push_back({Pose::Identity(), Matrix6d::Zero(), {}, rig.structure});
    joint.refined.lenses.resize(3);
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
              stages->Refined(2).solved = false;
              stages->Refined(2).problem = "its solution is no number";
            }),
            SensorCode::kUnsolved);
  EXPECT_EQ(code([](Stages* stages) {
              stages->Refined(2).structure_from_sensor = stages->Refined(0).structure_from_sensor;
            }),
            SensorCode::kSamePose);
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
  stages.joint.refined.placements.front().built =
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
    RefinedLens& lens = stages.joint.refined.lenses[stages.joint.seen.lenses.of_frame[{0, 2}]];
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

/// Three sensors that see the structure from one place: two that geometry has located, of which the
/// joint solution takes the second half a metre away, and one that a network has located, which it
/// takes there as well.
class Shapeless : public testing::Test {
 protected:
  void SetUp() override {
    Pose away = truth_;
    away.translation().x() += 0.5;
    std::vector<SensorView> views;
    std::vector<LocateResult> located;
    for (const bool geometry : {true, true, false}) {
      frames_[{0, views.size()}] = FrameInput();
      views.push_back(See(structure_, truth_));
      LocatedFrame frame;
      if (geometry) frame.shape_log_odds = 1;
      located.emplace_back(std::move(frame));
    }
    seen_.views = PerFrame<SensorView>({views});
    located_ = PerFrame<LocateResult>({located});
    refined_.placements.push_back({Pose::Identity(), {}, {}, structure_});
    for (const Pose& pose : {truth_, away, away}) {
      refined_.frames.emplace_back();
      refined_.frames.back().structure_from_sensor = pose;
    }
  }

  SomeFrames<Finding> Find() const { return FindShapeless(seen_, located_, frames_, refined_); }

  const Structure structure_ = PaperStructure();
  const Pose truth_ = RingPose(40);
  Seen seen_;
  PerFrame<LocateResult> located_;
  SomeFrames<FrameInput> frames_;
  RefineResult refined_;
};

TEST_F(Shapeless, IsASensorThatGeometryAloneLocated) {
  const SomeFrames<Finding> found = Find();
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found.at({0, 1}).code, SensorCode::kNoStructure);
}

// What was refined are the located frames alone.
TEST_F(Shapeless, FramesThatAreNotLocatedHaveNoPose) {
  located_[{0, 0}] = Finding();
  frames_.erase({0, 0});
  refined_.frames.erase(refined_.frames.begin());
  refined_.frames[0].structure_from_sensor = truth_;
  EXPECT_TRUE(Find().empty());
}

TEST(StandsStill, WhereAFrameMovesByLessThanItsPositionIsKnownTo) {
  RefinedFrame refined;
  for (const double sigma : {0.0001, 0.005}) {
    refined.covariance = sigma * sigma * Matrix6d::Identity();
    const double limit = std::max(0.002, sigma);
    EXPECT_TRUE(StandsStill(0.9 * limit, refined)) << sigma;
    EXPECT_FALSE(StandsStill(1.1 * limit, refined)) << sigma;
    EXPECT_FALSE(StandsStill(std::nan(""), refined)) << sigma;
  }
}

// Results of single captures, made by hand, and what they say together.

Pose At(double x) { return MakePose({0, 0, 0}, {x, 0, 0}); }

/// Captures of one sensor, one after the other.
struct OneSensor {
  std::vector<Capture> captures;
  std::vector<CaptureResult> results;
  SomeFrames<FrameSolution> frames;

  void Add(FrameResult sensor) {
    SensorFrame frame;
    sensor.name = frame.name = "S";
    captures.push_back({"capture " + std::to_string(captures.size()), {frame}});
    CaptureResult result;
    result.first_from_placement = At(0.1 * static_cast<double>(results.size()));
    result.sensors.push_back(std::move(sensor));
    results.push_back(std::move(result));
  }
  /// With its pose in the structure of the first capture.
  void AddPlaced(FrameResult sensor, const Pose& first_from_sensor) {
    RefinedFrame& refined = frames[{captures.size(), 0}].refined;
    refined.solved = true;
    refined.first_from_sensor = first_from_sensor;
    sensor.structure_from_sensor = first_from_sensor;
    Add(std::move(sensor));
  }
  FrameResult Combined() const {
    const CalibrationResult result = CombineCaptures(CaptureSet(captures, {}), results, frames);
    EXPECT_EQ(result.captures.size(), captures.size());
    EXPECT_EQ(result.sensors.size(), 1u);
    return result.sensors.front();
  }
};

FrameResult Result(SensorStatus status, SensorCode code) {
  FrameResult result;
  result.status = status;
  result.code = code;
  result.reason = ToString(code);
  return result;
}

TEST(CombineCaptures, FiguresAreWeighedByPoints) {
  FrameResult weak = Result(SensorStatus::kWeak, SensorCode::kFewInliers);
  weak.points = 100;
  weak.inlier_share = 0.5;
  weak.rms_to_structure_m = 0.003;
  weak.depth_offset_m = 0.001;
  weak.sides = {"bottom/front"};
  FrameResult ok = Result(SensorStatus::kOk, SensorCode::kNone);
  ok.points = 300;
  ok.inlier_share = 0.9;
  ok.rms_to_structure_m = 0.005;
  ok.depth_offset_m = 0.002;
  ok.sides = {"bottom/front", "bottom/back"};
  FrameResult failed = Result(SensorStatus::kFailed, SensorCode::kNoStructure);
  failed.points = 1000;
  OneSensor made;
  made.Add(failed);
  made.AddPlaced(weak, At(2));
  made.AddPlaced(ok, At(2));
  const FrameResult sensor = made.Combined();
  EXPECT_EQ(sensor.status, SensorStatus::kOk);
  EXPECT_EQ(sensor.points, 400);
  EXPECT_NEAR(sensor.inlier_share, 0.8, 1e-12);
  EXPECT_NEAR(sensor.rms_to_structure_m, 0.001 * std::sqrt((9 + 3 * 25) / 4.0), 1e-12);
  EXPECT_EQ(sensor.sides, (std::vector<std::string>{"bottom/back", "bottom/front"}));
  EXPECT_EQ(sensor.depth_offset_m, 0.002) << "of the capture in which it is ok";
}

TEST(CombineCaptures, ASensorStandsWhereMostCapturesHaveIt) {
  const FrameResult ok = Result(SensorStatus::kOk, SensorCode::kNone);
  OneSensor made;
  made.AddPlaced(ok, At(2.2));
  made.AddPlaced(ok, At(2));
  made.AddPlaced(ok, At(2.01));
  EXPECT_NEAR(made.Combined().structure_from_sensor->translation().x(), 2, 1e-12);
  made.frames.at({1, 0}).refined.refused_fit = RefusedFit();
  EXPECT_NEAR(made.Combined().structure_from_sensor->translation().x(), 2.01, 1e-12)
      << "the one that agrees with the others";
}

TEST(CombineCaptures, WhatIsWrongWithTheSensorShowsInOneCapture) {
  OneSensor made;
  made.AddPlaced(Result(SensorStatus::kOk, SensorCode::kNone), At(2));
  made.AddPlaced(Result(SensorStatus::kWeak, SensorCode::kLabelsDisagree), At(2));
  EXPECT_EQ(made.Combined().status, SensorStatus::kOk) << "what is wrong with one view";
  made.AddPlaced(Result(SensorStatus::kWeak, SensorCode::kIntrinsicsSuspect), At(2));
  const FrameResult sensor = made.Combined();
  EXPECT_EQ(sensor.status, SensorStatus::kWeak);
  EXPECT_EQ(sensor.code, SensorCode::kIntrinsicsSuspect);
  EXPECT_EQ(sensor.reason, ToString(SensorCode::kIntrinsicsSuspect));
}

TEST(CombineCaptures, OfASensorThatIsPlacedInNoneTheMostTellingReason) {
  OneSensor made;
  made.Add(Result(SensorStatus::kFailed, SensorCode::kNoStructure));
  made.Add(Result(SensorStatus::kFailed, SensorCode::kUnconnected));
  const FrameResult sensor = made.Combined();
  EXPECT_FALSE(sensor.structure_from_sensor);
  EXPECT_EQ(sensor.status, SensorStatus::kFailed);
  EXPECT_EQ(sensor.code, SensorCode::kUnconnected);
}

TEST(CombineCaptures, PairsAreOfTheCaptureWithMostOverlapAndInTheStructureOfTheFirst) {
  OneSensor two;
  two.Add(Result(SensorStatus::kFailed, SensorCode::kNoDepth));
  two.Add(Result(SensorStatus::kFailed, SensorCode::kNoDepth));
  two.results[1].first_from_placement = Pose(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY()));
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal() << 1, 2, 3, 4, 5, 6;
  two.results[0].pairs = {{"T", "S", 0.2}};
  two.results[1].pairs = {{"S", "T", 0.5, 0.001, 0.002, covariance, 0.1, 2}};
  const CalibrationResult result = CombineCaptures(CaptureSet(two.captures, {}), two.results, {});
  ASSERT_EQ(result.pairs.size(), 1u);
  covariance.diagonal() << 3, 2, 1, 6, 5, 4;
  EXPECT_TRUE(result.pairs[0].covariance.isApprox(covariance, 1e-9));
  EXPECT_EQ(result.pairs[0].sigma_m, 0.1);
  EXPECT_EQ(result.pairs[0].predicted_rms_m, 0.002);
}

// S is absent from the first capture; T is in both, and its truths say where the structure stood in
// the second.
TEST(CombineCaptures, ComparesASensorThatIsAbsentFromTheFirstCaptureWithItsTruth) {
  const auto frame = [](const std::string& name, double x) {
    SensorFrame sensor;
    sensor.name = name;
    sensor.ground_truth = At(x);
    return sensor;
  };
  const std::vector<Capture> captures = {{"first", {frame("T", 1)}},
                                         {"second", {frame("T", 0.25), frame("S", 2)}}};
  const CaptureSet input(captures, {});
  std::vector<CaptureResult> results(2);
  SomeFrames<FrameSolution> frames;
  for (const FrameId id : input.sensor_of.Ids()) {
    FrameResult sensor = Result(SensorStatus::kOk, SensorCode::kNone);
    sensor.name = input[id].name;
    sensor.structure_from_sensor = At(0);
    frames[id].refined.first_from_sensor = At(sensor.name == "S" ? 2.85 : 1);
    results[id.capture].sensors.push_back(sensor);
  }
  results[1].first_from_placement = At(0.75);
  const CalibrationResult result = CombineCaptures(input, results, frames);
  for (const FrameResult& sensor : result.sensors) {
    ASSERT_TRUE(sensor.error) << sensor.name;
    EXPECT_NEAR(sensor.error->translation_m, sensor.name == "S" ? 0.1 : 0, 1e-9) << sensor.name;
  }
}

SensorFrame Frame(const std::string& name, float depth) {
  SensorFrame frame;
  frame.name = name;
  frame.depth = DepthImage(4, 3, depth);
  frame.intrinsics.width = 4;
  frame.intrinsics.height = 3;
  frame.intrinsics.fx = frame.intrinsics.fy = 5;
  frame.sensor = "kind";
  return frame;
}

/// Two sensors in two captures, as a calibration may have them.
struct Request {
  std::vector<Capture> captures{{"first", {Frame("A", 1), Frame("B", 2)}},
                                {"second", {Frame("A", 3), Frame("B", 4)}}};
  CalibrateOptions options;
  bool model = true;

  void Measure(std::size_t capture, std::size_t sensor, float depth) {
    captures[capture].frames[sensor].depth = DepthImage(4, 3, depth);
  }
  SensorFrame& OfSecond(std::size_t sensor) { return captures[1].frames[sensor]; }
  void Check() const { CheckRequest(captures, Structure(), options, model); }
};

TEST(CheckRequest, LetsThroughWhatCanBeCalibrated) {
  const std::vector<std::function<void(Request*)>> changes = {
      [](Request*) {},
      [](Request* request) { request->captures.pop_back(); },
      // A sensor may be absent from a capture, and each may see nothing at all there.
      [](Request* request) { request->captures[1].frames.pop_back(); },
      [](Request* request) {
        for (const std::size_t capture : {0, 1}) request->Measure(capture, 0, 0);
      },
      // The same depth map of two sensors is found later, sensor by sensor.
      [](Request* request) { request->Measure(0, 1, 1); },
      [](Request* request) {
        request->model = false;
        request->options.initial.method = PoseMethod::kGeometry;
      },
      [](Request* request) { request->model = false; },
  };
  for (std::size_t i = 0; i < changes.size(); ++i) {
    Request request;
    changes[i](&request);
    EXPECT_NO_THROW(request.Check()) << "case " << i;
  }
}

TEST(CheckRequest, NamesWhatIsWrongWithTheFrames) {
  struct Case {
    std::function<void(Request*)> change;
    std::vector<std::string> words;
  };
  const std::vector<Case> cases = {
      {[](Request* request) { request->captures.clear(); }, {"no capture"}},
      {[](Request* request) { request->captures[1].name = "first"; }, {"captures", "\"first\""}},
      {[](Request* request) { request->OfSecond(1).name = "A"; }, {"sensors", "\"A\""}},
      {[](Request* request) { request->OfSecond(1).intrinsics.fx = 6; },
       {"\"B\"", "intrinsics", "first", "second"}},
      {[](Request* request) { request->OfSecond(0).sensor = "other"; }, {"\"A\"", "kind"}},
      {[](Request* request) {
         request->OfSecond(0).prior = PosePrior{Pose::Identity(), PriorWorld::kStructure, 0.05, 3};
         request->OfSecond(1).prior = PosePrior{Pose::Identity(), PriorWorld::kMetric, 0.05, 3};
       },
       {"\"A\"", "\"B\"", "different worlds"}},
      {[](Request* request) {
         request->OfSecond(0).prior = PosePrior{Pose::Identity(), PriorWorld::kStructure, 0, 3};
       },
       {"\"A\"", "standard deviation of 0"}},
      {[](Request* request) {
         request->OfSecond(1).prior = PosePrior{Pose::Identity(), PriorWorld::kMetric, 0.05, 1e9};
       },
       {"\"B\"", "standard deviation of 1"}},
      {[](Request* request) { request->Measure(1, 1, 2); },
       {"\"B\"", "same depth map", "first", "second"}},
  };
  for (const Case& c : cases) {
    Request request;
    c.change(&request);
    const std::string message = ExpectError<DataError>([&] { request.Check(); });
    for (const std::string& word : c.words) EXPECT_TRUE(Has(message, word));
  }
}

// One measured pixel that is the same in both is enough to show something; one that differs is
// enough to be another frame.
TEST(CheckRequest, ComparesEveryPixel) {
  Request request;
  for (const std::size_t capture : {0, 1}) {
    request.Measure(capture, 0, 0);
    request.captures[capture].frames[0].depth(2, 1) = 1.5f;
  }
  ExpectError<DataError>([&] { request.Check(); });
  request.OfSecond(0).depth(3, 2) = 1;
  EXPECT_NO_THROW(request.Check());
}

TEST(CheckRequest, ComparesEveryTwoCaptures) {
  Request request;
  request.captures.push_back(request.captures[1]);
  request.captures[2].name = "third";
  ExpectError<DataError>([&] { request.Check(); }, {"in third as in second"});
}

TEST(CheckRequest, NamesWhatIsWrongWithTheOptions) {
  Request request;
  request.options.initial.method = PoseMethod::kNetwork;
  EXPECT_NO_THROW(request.Check());
  request.model = false;
  ExpectError<ConfigError>([&] { request.Check(); }, {"no model"});
  Request estimate;
  estimate.options.refine.estimate = "boxes, weather";
  ExpectError<ConfigError>([&] { estimate.Check(); }, {"weather"});
  Request range;
  range.options.threads = 0;
  ExpectError<ConfigError>([&] { range.Check(); }, {"threads"});
}

}  // namespace
}  // namespace volalign::judge_test

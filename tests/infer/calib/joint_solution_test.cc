#include "infer/calib/joint_solution.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "infer/calib/combine_captures.h"
#include "tests/infer/initial/geometry_frames.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::joint_solution_test {
namespace {

using namespace testing_infer;

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

}  // namespace
}  // namespace volalign::joint_solution_test

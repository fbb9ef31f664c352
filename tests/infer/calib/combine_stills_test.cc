// Results of single stills, made by hand, and what they say together.

#include "infer/calib/combine_stills.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace volalign::combine_stills_test {
namespace {

Pose At(double x) {
  Pose pose = Pose::Identity();
  pose.translation().x() = x;
  return pose;
}

/// Stills of one sensor, one after the other.
struct OneSensor {
  std::vector<Still> stills;
  std::vector<StillResult> results;
  SomeFrames<FrameSolution> frames;

  void Add(FrameResult sensor) {
    SensorFrame frame;
    sensor.name = frame.name = "S";
    stills.push_back({"still " + std::to_string(stills.size()), {frame}});
    StillResult result;
    result.first_from_placement = At(0.1 * static_cast<double>(results.size()));
    result.sensors.push_back(std::move(sensor));
    results.push_back(std::move(result));
  }
  /// With its pose in the structure of the first still.
  void AddPlaced(FrameResult sensor, const Pose& first_from_sensor) {
    RefinedFrame& refined = frames[{stills.size(), 0}].refined;
    refined.solved = true;
    refined.first_from_sensor = first_from_sensor;
    sensor.structure_from_sensor = first_from_sensor;
    Add(std::move(sensor));
  }
  FrameResult Combined() const {
    const CalibrationResult result = CombineStills(CaptureSet(stills, {}), results, frames);
    EXPECT_EQ(result.stills.size(), stills.size());
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

TEST(CombineStills, FiguresAreWeighedByPoints) {
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
  EXPECT_EQ(sensor.depth_offset_m, 0.002) << "of the still in which it is ok";
}

TEST(CombineStills, ASensorStandsWhereMostStillsHaveIt) {
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

TEST(CombineStills, WhatIsWrongWithTheSensorShowsInOneStill) {
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

TEST(CombineStills, OfASensorThatIsPlacedInNoneTheMostTellingReason) {
  OneSensor made;
  made.Add(Result(SensorStatus::kFailed, SensorCode::kNoStructure));
  made.Add(Result(SensorStatus::kFailed, SensorCode::kUnconnected));
  const FrameResult sensor = made.Combined();
  EXPECT_FALSE(sensor.structure_from_sensor);
  EXPECT_EQ(sensor.status, SensorStatus::kFailed);
  EXPECT_EQ(sensor.code, SensorCode::kUnconnected);
}

TEST(CombineStills, PairsAreOfTheStillWithMostOverlapAndInTheStructureOfTheFirst) {
  OneSensor two;
  two.Add(Result(SensorStatus::kFailed, SensorCode::kNoDepth));
  two.Add(Result(SensorStatus::kFailed, SensorCode::kNoDepth));
  two.results[1].first_from_placement = Pose(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY()));
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal() << 1, 2, 3, 4, 5, 6;
  two.results[0].pairs = {{"T", "S", 0.2}};
  two.results[1].pairs = {{"S", "T", 0.5, 0.001, 0.002, covariance, 0.1, 2}};
  const CalibrationResult result = CombineStills(CaptureSet(two.stills, {}), two.results, {});
  ASSERT_EQ(result.pairs.size(), 1u);
  covariance.diagonal() << 3, 2, 1, 6, 5, 4;
  EXPECT_TRUE(result.pairs[0].covariance.isApprox(covariance, 1e-9));
  EXPECT_EQ(result.pairs[0].sigma_m, 0.1);
  EXPECT_EQ(result.pairs[0].predicted_rms_m, 0.002);
}

// S is absent from the first still; T is in both, and its truths say where the structure stood in
// the second.
TEST(CombineStills, ComparesASensorThatIsAbsentFromTheFirstStillWithItsTruth) {
  const auto frame = [](const std::string& name, double x) {
    SensorFrame sensor;
    sensor.name = name;
    sensor.ground_truth = At(x);
    return sensor;
  };
  const std::vector<Still> stills = {{"first", {frame("T", 1)}},
                                     {"second", {frame("T", 0.25), frame("S", 2)}}};
  const CaptureSet capture(stills, {});
  std::vector<StillResult> results(2);
  SomeFrames<FrameSolution> frames;
  for (const FrameId id : capture.sensor_of.Ids()) {
    FrameResult sensor = Result(SensorStatus::kOk, SensorCode::kNone);
    sensor.name = capture[id].name;
    sensor.structure_from_sensor = At(0);
    frames[id].refined.first_from_sensor = At(sensor.name == "S" ? 2.85 : 1);
    results[id.still].sensors.push_back(sensor);
  }
  results[1].first_from_placement = At(0.75);
  const CalibrationResult result = CombineStills(capture, results, frames);
  for (const FrameResult& sensor : result.sensors) {
    ASSERT_TRUE(sensor.error) << sensor.name;
    EXPECT_NEAR(sensor.error->translation_m, sensor.name == "S" ? 0.1 : 0, 1e-9) << sensor.name;
  }
}

}  // namespace
}  // namespace volalign::combine_stills_test

#include "infer/calib/result.h"

#include <gtest/gtest.h>

#include <limits>

namespace volalign::result_test {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

SensorOutcome Placed() {
  SensorOutcome sensor;
  sensor.status = SensorStatus::kOk;
  sensor.structure_from_sensor = Pose::Identity();
  return sensor;
}

TEST(DemoteIfNotFinite, LeavesFiniteNumbersAlone) {
  SensorOutcome sensor = Placed();
  DemoteIfNotFinite(&sensor);
  EXPECT_EQ(sensor.status, SensorStatus::kOk);
  EXPECT_EQ(sensor.code, SensorCode::kNone);
  // Of a sensor without a pose no number counts.
  sensor.structure_from_sensor.reset();
  sensor.status = SensorStatus::kFailed;
  sensor.code = SensorCode::kNoDepth;
  sensor.miou = kNan;
  DemoteIfNotFinite(&sensor);
  EXPECT_EQ(sensor.code, SensorCode::kNoDepth);
}

TEST(DemoteIfNotFinite, ThePoseItselfFailsTheSensor) {
  SensorOutcome sensor = Placed();
  sensor.structure_from_sensor->translation().y() = kNan;
  DemoteIfNotFinite(&sensor);
  EXPECT_FALSE(sensor.structure_from_sensor);
  EXPECT_EQ(sensor.status, SensorStatus::kFailed);
  EXPECT_EQ(sensor.code, SensorCode::kNotFinite);
}

TEST(DemoteIfNotFinite, OtherNumbersMakeItWeakAndAreNamed) {
  SensorOutcome sensor = Placed();
  sensor.rms_to_structure_m = kNan;
  sensor.covariance(2, 3) = std::numeric_limits<double>::infinity();
  DemoteIfNotFinite(&sensor);
  EXPECT_TRUE(sensor.structure_from_sensor);
  EXPECT_EQ(sensor.status, SensorStatus::kWeak);
  EXPECT_EQ(sensor.code, SensorCode::kNotFinite);
  EXPECT_NE(sensor.reason.find("rms_to_structure_m"), std::string::npos) << sensor.reason;
  EXPECT_NE(sensor.reason.find("covariance"), std::string::npos) << sensor.reason;
  EXPECT_EQ(sensor.reason.find("miou"), std::string::npos) << sensor.reason;

  // What it was weak for before stays, but that it is uncertain.
  sensor = Placed();
  sensor.status = SensorStatus::kWeak;
  sensor.code = SensorCode::kFewInliers;
  sensor.reason = "few points";
  sensor.miou = kNan;
  DemoteIfNotFinite(&sensor);
  EXPECT_EQ(sensor.code, SensorCode::kFewInliers);
  EXPECT_EQ(sensor.reason.rfind("few points; not finite", 0), 0u) << sensor.reason;
  sensor.code = SensorCode::kUncertain;
  DemoteIfNotFinite(&sensor);
  EXPECT_EQ(sensor.code, SensorCode::kNotFinite);
}

TEST(CalibrationResult, HasTheWorstVerdictAndCountsPoses) {
  CalibrationResult result;
  EXPECT_EQ(result.verdict(), SensorStatus::kOk);
  EXPECT_EQ(result.placed(), 0);
  result.findings.resize(1);
  EXPECT_EQ(result.verdict(), SensorStatus::kWeak);
  result.findings.clear();
  result.sensors.resize(3);
  for (FrameResult& sensor : result.sensors) static_cast<SensorOutcome&>(sensor) = Placed();
  result.sensors[1].status = SensorStatus::kWeak;
  EXPECT_EQ(result.verdict(), SensorStatus::kWeak);
  EXPECT_EQ(result.placed(), 3);
  result.sensors[0].status = SensorStatus::kFailed;
  result.sensors[0].structure_from_sensor.reset();
  EXPECT_EQ(result.verdict(), SensorStatus::kFailed);
  EXPECT_EQ(result.placed(), 2);
}

}  // namespace
}  // namespace volalign::result_test

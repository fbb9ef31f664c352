// Captures whose sensors look through lenses that the capture states, leaves out or gets wrong.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "infer/calib/calibrate.h"
#include "tests/core/base/expect_error.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_lens_test {
namespace {

using namespace testing_infer;

constexpr char kAzureKinect[] = "azure_kinect_nfov_binned";

/// Five Azure Kinects round exact boxes in a room, with errors as they have them. What the capture
/// says about their lenses is up to each test: here, all of it.
Rig LensRig(std::uint64_t seed) {
  Rig rig{PaperStructure(), {}, {}};
  RandomStream random(seed, 0, "lens rig");
  for (int i = 0; i < 5; ++i)
    rig.Add("K" + std::to_string(i),
            RingPose(72.0 * i + random.Normal(0, 8), 2.0, 0.3 + 0.1 * (i % 3)), {true, 3.2},
            KinectWithLens());
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    AddNoise(&rig.frames[i].depth, 0.001, 100 * seed + i);
    AddSmoothError(&rig.frames[i].depth, 0.0015, 40, 100 * seed + i);
  }
  return rig;
}

Rig WithoutDistortion(Rig rig, const std::string& kind) {
  for (SensorFrame& frame : rig.frames) {
    frame.intrinsics.distortion.clear();
    frame.sensor = kind;
  }
  return rig;
}

struct Errors {
  double median_mm = 0, median_deg = 0;
  int within_3_sigma = 0;  ///< of all sensors' six pose parameters
};

Errors ErrorsOf(const Rig& rig, const CalibrationResult& result) {
  std::vector<double> mm, deg;
  Errors errors;
  for (std::size_t i = 0; i < result.sensors.size(); ++i) {
    const FrameResult& sensor = result.sensors[i];
    EXPECT_TRUE(sensor.error.has_value()) << sensor.name << ": " << sensor.reason;
    if (!sensor.error) return {};
    mm.push_back(1000 * sensor.error->translation_m);
    deg.push_back(sensor.error->rotation_deg);
    const Vector6d delta =
        LeftDifference(*sensor.structure_from_sensor, *rig.frames[i].ground_truth);
    for (int k = 0; k < 6; ++k)
      errors.within_3_sigma += std::abs(delta[k]) < 3 * std::sqrt(sensor.covariance(k, k));
  }
  std::sort(mm.begin(), mm.end());
  std::sort(deg.begin(), deg.end());
  errors.median_mm = mm[mm.size() / 2];
  errors.median_deg = deg[deg.size() / 2];
  return errors;
}

// An Azure Kinect's pinhole is off by 10 % at the ends of the picture: sensors then stood up to 5
// cm off, with standard deviations of 4 mm.
TEST(CalibrateLens, ALensThatTheCaptureDoesNotStateIsFound) {
  for (const std::string kind : {"", kAzureKinect}) {
    const Rig rig = WithoutDistortion(LensRig(1), kind);
    const CalibrationResult result = CalibrateRig(rig);
    const Errors errors = ErrorsOf(rig, result);
    EXPECT_LT(errors.median_mm, 5) << kind;
    EXPECT_LT(errors.median_deg, 0.2) << kind;
    EXPECT_GE(errors.within_3_sigma, 28) << kind << ", of 30";
    for (const FrameResult& sensor : result.sensors) {
      // The effective intrinsics see what the true ones see.
      EXPECT_LT(LargestShift(KinectWithLens(), sensor.intrinsics), kind.empty() ? 8 : 3)
          << sensor.name;
      EXPECT_NE(sensor.intrinsics.distortion, rig.frames[0].intrinsics.distortion);
    }
  }
}

TEST(CalibrateLens, AStatedLensStays) {
  const Rig rig = LensRig(2);
  const CalibrationResult result = CalibrateRig(rig);
  const Errors errors = ErrorsOf(rig, result);
  EXPECT_LT(errors.median_mm, 5);
  EXPECT_LT(errors.median_deg, 0.1);
  for (const FrameResult& sensor : result.sensors) {
    EXPECT_EQ(sensor.status, SensorStatus::kOk) << sensor.reason;
    EXPECT_LT(LargestShift(KinectWithLens(), sensor.intrinsics), 2) << sensor.name;
  }
}

TEST(CalibrateLens, OneSensorsLensIsFoundAmongOthers) {
  Rig rig = LensRig(3);
  rig.frames[2].intrinsics.distortion.clear();
  const CalibrationResult result = CalibrateRig(rig);
  EXPECT_LT(ErrorsOf(rig, result).median_mm, 5);
  for (std::size_t i = 0; i < result.sensors.size(); ++i)
    EXPECT_EQ(result.sensors[i].lens.source, i == 2 ? LensSource::kRecognised : LensSource::kGiven)
        << i << ": " << ToString(result.sensors[i].lens.source);
}

TEST(CalibrateLens, ALensThatIsSeenButNotEstimatedIsNamed) {
  CalibrateOptions options;
  options.refine.estimate = "none";
  const CalibrationResult result = CalibrateRig(WithoutDistortion(LensRig(4), ""), options);
  for (const FrameResult& sensor : result.sensors) {
    EXPECT_EQ(sensor.status, SensorStatus::kWeak);
    EXPECT_EQ(sensor.code, SensorCode::kLensSuspect) << ToString(sensor.code);
    EXPECT_TRUE(Has(sensor.reason, " mm"));
    EXPECT_TRUE(sensor.intrinsics.distortion.empty());
    EXPECT_EQ(sensor.lens.source, LensSource::kGiven);
  }
}

// A capture that says that images are rectified when they are not.
TEST(CalibrateLens, AWrongStatementIsNamed) {
  Rig rig = LensRig(5);
  for (SensorFrame& frame : rig.frames) frame.intrinsics.distortion.assign(5, 0.0);
  const CalibrationResult result = CalibrateRig(rig);
  for (const FrameResult& sensor : result.sensors) {
    EXPECT_EQ(sensor.status, SensorStatus::kWeak) << sensor.name;
    EXPECT_EQ(sensor.code, SensorCode::kLensSuspect) << ToString(sensor.code);
  }
}

TEST(CalibrateLens, APinholeIsNotTakenForALens) {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 4; ++i) rig.Add(RingPose(25 + 90.0 * i), {true, 3.5});
  for (std::size_t i = 0; i < rig.frames.size(); ++i)
    AddSmoothError(&rig.frames[i].depth, 0.003, 40, i);
  for (const FrameResult& sensor : CalibrateRig(rig).sensors) {
    EXPECT_EQ(sensor.status, SensorStatus::kOk) << sensor.reason;
    EXPECT_TRUE(sensor.intrinsics == Kinect()) << sensor.name;
  }
}

}  // namespace
}  // namespace volalign::calibrate_lens_test

// Captures whose sensors look through lenses that the capture states, leaves out or gets wrong.

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "infer/calib/calibrate.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/geometry/within.h"
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

// An Azure Kinect's pinhole is off by 10 % at the ends of the picture: sensors then stood up to 5
// cm off, with standard deviations of 4 mm.
TEST(CalibrateLens, ALensThatTheCaptureDoesNotStateIsFound) {
  for (const std::string kind : {"", kAzureKinect}) {
    const Rig rig = WithoutDistortion(LensRig(1), kind);
    const CalibrationResult result = CalibrateRig(rig);
    for (std::size_t i = 0; i < result.sensors.size(); ++i) {
      const FrameResult& sensor = result.sensors[i];
      ASSERT_TRUE(sensor.error.has_value()) << sensor.name << ": " << sensor.reason;
      EXPECT_TRUE(Within(*sensor.error, 0.008, 0.3)) << kind << sensor.name;
      EXPECT_LT(SquaredError(sensor, rig.frames[i]), 22.5) << kind << sensor.name;
      // The effective intrinsics see what the true ones see.
      EXPECT_LT(LargestShift(KinectWithLens(), sensor.intrinsics), kind.empty() ? 8 : 3)
          << sensor.name;
      EXPECT_NE(sensor.intrinsics.distortion, rig.frames[0].intrinsics.distortion);
    }
  }
}

TEST(CalibrateLens, OneSensorsLensIsFoundAmongOthers) {
  Rig rig = LensRig(3);
  rig.frames[2].intrinsics.distortion.clear();
  const CalibrationResult result = CalibrateRig(rig);
  for (std::size_t i = 0; i < result.sensors.size(); ++i) {
    EXPECT_LT(result.sensors[i].error.value().translation_m, 0.008) << i;
    EXPECT_EQ(result.sensors[i].lens.source, i == 2 ? LensSource::kRecognised : LensSource::kGiven)
        << i << ": " << ToString(result.sensors[i].lens.source);
  }
}

// A capture that says nothing of a lens that is not estimated either, and one that says that images
// are rectified when they are not.
TEST(CalibrateLens, ALensThatIsSeenAndNotEstimatedIsNamed) {
  for (const bool stated : {false, true}) {
    Rig rig = WithoutDistortion(LensRig(4), "");
    CalibrateOptions options;
    if (!stated) options.refine.estimate = "none";
    for (SensorFrame& frame : rig.frames) frame.intrinsics.distortion.resize(stated ? 5 : 0);
    for (const FrameResult& sensor : CalibrateRig(rig, options).sensors) {
      EXPECT_EQ(sensor.status, SensorStatus::kWeak) << sensor.name;
      EXPECT_EQ(sensor.code, SensorCode::kLensSuspect) << ToString(sensor.code);
      EXPECT_TRUE(Has(sensor.reason, " mm"));
      if (stated) continue;
      EXPECT_EQ(sensor.intrinsics, rig.frames[0].intrinsics);
      EXPECT_EQ(sensor.lens.source, LensSource::kGiven);
    }
  }
}

}  // namespace
}  // namespace volalign::calibrate_lens_test

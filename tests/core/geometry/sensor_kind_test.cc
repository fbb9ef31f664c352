#include "core/geometry/sensor_kind.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/camera.h"
#include "core/geometry/lens.h"
#include "tests/core/base/expect_error.h"

namespace volalign::sensor_kind_test {
namespace {

TEST(FindSensorKind, IsTheOneWithTheLongestNameThatItBeginsWith) {
  const SensorKind* azure = FindSensorKind("azure_kinect_nfov_binned");
  ASSERT_NE(azure, nullptr);
  EXPECT_EQ(azure->principle, DepthPrinciple::kTimeOfFlight);
  ASSERT_TRUE(azure->lens.has_value());
  EXPECT_FALSE(azure->lens->rectified());
  ASSERT_NE(FindSensorKind("realsense_d415"), nullptr);
  EXPECT_EQ(FindSensorKind("realsense_d415")->name, "realsense");
  EXPECT_TRUE(FindSensorKind("realsense_d415")->lens->rectified());
  EXPECT_EQ(FindSensorKind("realsense_d455")->name, "realsense_d455");
  ASSERT_NE(FindSensorKind("kinect_v1"), nullptr);
  EXPECT_FALSE(FindSensorKind("kinect_v1")->lens.has_value());
  EXPECT_EQ(FindSensorKind("my_azure_kinect"), nullptr);
  EXPECT_EQ(FindSensorKind("unknown"), nullptr);
  EXPECT_EQ(FindSensorKind(""), nullptr);
}

TEST(MeasuresBy, IsOfKnownKindsOnly) {
  EXPECT_TRUE(MeasuresBy(DepthPrinciple::kStereo, "realsense_d455"));
  EXPECT_TRUE(MeasuresBy(DepthPrinciple::kStereo, "kinect_v1"));
  EXPECT_TRUE(MeasuresBy(DepthPrinciple::kTimeOfFlight, "kinect_v2"));
  EXPECT_FALSE(MeasuresBy(DepthPrinciple::kTimeOfFlight, "kinect_v1"));
  for (const DepthPrinciple principle : {DepthPrinciple::kStereo, DepthPrinciple::kTimeOfFlight})
    EXPECT_FALSE(MeasuresBy(principle, "lidar"));
}

// One design: units of it differ in scale by more than any other kind's.
TEST(SensorKinds, TheFirstKinectsDesignHasThreeNames) {
  const DepthErrorModel& kinect = ErrorsOf("kinect_v1");
  EXPECT_GT(kinect.unit_gain, 3 * ErrorsOf("realsense_d415").unit_gain);
  EXPECT_EQ(ErrorsOf("azure_kinect_nfov_binned").unit_gain, ErrorsOf("").unit_gain);
  for (const char* name : {"asus_xtion", "asus_xtion_pro_live", "primesense_carmine"}) {
    EXPECT_TRUE(MeasuresBy(DepthPrinciple::kStereo, name)) << name;
    EXPECT_EQ(ErrorsOf(name).white_m, kinect.white_m) << name;
    EXPECT_EQ(ErrorsOf(name).unit_gain, kinect.unit_gain) << name;
  }
}

TEST(SensorKinds, EachSaysHowItsDepthsErr) {
  std::vector<DepthErrorModel> all = {ErrorsOf("lidar")};
  for (const SensorKind& kind : SensorKinds()) all.push_back(kind.errors);
  ASSERT_GT(all.size(), 6U);
  for (const DepthErrorModel& errors : all) {
    for (const double sigma :
         {errors.white_m, errors.smooth_m, errors.seam_m, errors.gain, errors.unit_gain,
          errors.seam_reach_m, errors.lateral_rad, errors.smooth_rad})
      EXPECT_GT(sigma, 0);
    // A few millimetres near, and no more than a decimetre at the far end of a capture volume.
    EXPECT_GT(errors.Sigma(1), 0.002);
    EXPECT_LT(errors.Sigma(4), 0.1);
  }
}

/// z^2 s / (f B) of a stereo camera: 0.055 px of a D415 with f B = 51.9 px m, and 0.14 px that
/// neighbours share.
TEST(ErrorsOf, AStereoCamerasGrowWithTheSquareOfTheDepthAndWithItsShortBaseline) {
  const DepthErrorModel& d415 = ErrorsOf("realsense_d415");
  for (const double z : {1.0, 2.0, 3.0}) {
    EXPECT_NEAR(d415.White(z), z * z * 0.055 / 51.9, 0.02 * d415.White(z));
    EXPECT_NEAR(d415.Smooth(z), z * z * 0.14 / 51.9, 0.02 * d415.Smooth(z));
    // Baselines of 50 and 95 mm, focal lengths of 644.9 and 640 px.
    const std::pair<const char*, double> others[] = {{"realsense_d435", 0.050 * 644.9},
                                                     {"realsense_d455", 0.095 * 640}};
    for (const auto& [kind, scale] : others) {
      EXPECT_NEAR(ErrorsOf(kind).White(z) / d415.White(z), 51.9 / scale, 0.02);
      EXPECT_NEAR(ErrorsOf(kind).Smooth(z) / d415.Smooth(z), 51.9 / scale, 0.02);
    }
    EXPECT_NEAR(d415.TiltGrowth(z), z * z / 4, 1e-12);
  }
  // 0.1 px at the border, 640 px from the middle.
  const std::tuple<const char*, double, double> tilts[] = {{"realsense_d415", 943.6, 51.9},
                                                           {"realsense_d435", 644.9, 32.2},
                                                           {"realsense_d455", 640, 60.8}};
  for (const auto& [kind, focal, focal_baseline] : tilts) {
    const double expected = 0.1 * focal / 640 * 4 / focal_baseline;
    EXPECT_NEAR(ErrorsOf(kind).tilt_m, expected, 0.05 * expected) << kind;
  }
}

/// Residuals to local planes of real frames (docs/sensor-models.md), without the steps of 1 mm.
TEST(ErrorsOf, AnAzureKinectsAreThoseOfItsFrames) {
  const DepthErrorModel& azure = ErrorsOf("azure_kinect_nfov_binned");
  EXPECT_NEAR(azure.White(1.5), 0.0003, 1e-4);
  EXPECT_NEAR(azure.White(4.5), 0.0006, 1e-4);
  EXPECT_DOUBLE_EQ(azure.Smooth(4), 2 * azure.Smooth(2));
}

TEST(DepthErrorModel, PartsAreIndependent) {
  DepthErrorModel errors;
  errors.white_m = 0.003;
  errors.white_power = 1;
  errors.smooth_m = 0.004;
  errors.smooth_power = 2;
  EXPECT_DOUBLE_EQ(errors.WithinSurface(2), 0.005);
  EXPECT_DOUBLE_EQ(errors.WithinSurface(4), std::hypot(0.006, 0.016));
  errors.offset_m = 0.012;
  EXPECT_DOUBLE_EQ(errors.Sigma(2), 0.013);
  errors.offset_m = 0;
  errors.gain = 0.006;
  EXPECT_DOUBLE_EQ(errors.Sigma(2), 0.013);
  // What falls linearly from 0.03 to 0 has a root mean square of 0.03 / sqrt(3).
  errors = DepthErrorModel();
  errors.seam_m = 0.03;
  EXPECT_NEAR(errors.Sigma(2), std::sqrt(0.0003), 1e-12);
}

/// github.com/orbbec/OrbbecSDK, issue 56: a Femto Bolt, against the Azure Kinect's.
TEST(FindSensorKind, AFemtoBoltHasTheLensThatItsFactoryMeasured) {
  const SensorKind* bolt = FindSensorKind("orbbec_femto_bolt_nfov_binned");
  ASSERT_NE(bolt, nullptr);
  EXPECT_EQ(bolt->principle, DepthPrinciple::kTimeOfFlight);
  Intrinsics of_kind{320, 288, 252, 252, 160, 144, bolt->lens->distortion}, of_unit = of_kind;
  of_unit.distortion = {8.68957, 4.46817, 0, 0, 0.172922, 9.01699, 7.37854, 1.05598};
  for (const double radius : {0.2, 0.4, 0.6}) {
    const Eigen::Vector2d ray(radius, 0);
    EXPECT_NEAR(BendRay(of_kind, ray).bent.x() / BendRay(of_unit, ray).bent.x(), 1, 1.5e-3);
  }
}

TEST(FindSensorKind, KnowsTheSensorsThatOneCanBuy) {
  for (const char* name :
       {"azure_kinect_nfov_binned", "azure_kinect_nfov_unbinned", "azure_kinect_wfov_binned",
        "azure_kinect_wfov_unbinned", "orbbec_femto_bolt_wfov_unbinned", "orbbec_femto_mega",
        "orbbec_gemini_335", "realsense_d415", "realsense_d435", "realsense_d455", "kinect_v2",
        "oak_d"}) {
    const SensorKind* kind = FindSensorKind(name);
    ASSERT_NE(kind, nullptr) << name;
    ASSERT_TRUE(kind->lens.has_value()) << name;
    EXPECT_GT(kind->lens->own_focal_sigma, 0) << name;
    RequireSensorKind(name, "sensor");
  }
  for (const char* rectified : {"orbbec_gemini_335", "oak_d", "realsense_d455"})
    EXPECT_TRUE(FindSensorKind(rectified)->lens->rectified()) << rectified;
  ExpectError<ConfigError>([] { RequireSensorKind("femto_bolt", "sensor"); },
                           {"sensor = femto_bolt", "orbbec_femto", "kinect_v1"});
}

/// A mode of an Azure Kinect is a part of its chip, binned or not: the same directions are at the
/// same place of the chip (Azure Kinect Sensor SDK, mode_specific_calibration.c).
TEST(ReadIntrinsicsPool, TheModesOfADeviceAreOneLens) {
  struct Mode {
    const char* name;
    int pixels, left, top;  // per pixel of the unbinned chip; where its picture begins
  };
  const Mode modes[] = {{"nfov_unbinned", 1, 192, 180},
                        {"nfov_binned", 2, 192, 180},
                        {"wfov_binned", 2, 0, 0},
                        {"wfov_unbinned", 1, 0, 0}};
  const std::vector<IntrinsicsPoolEntry> pool = ReadIntrinsicsPool("configs/intrinsics.yaml");
  for (const std::string device : {"azure_kinect_", "orbbec_femto_bolt_", "orbbec_femto_mega_"}) {
    std::vector<Intrinsics> first;
    for (const Mode& mode : modes) {
      const auto entry = std::find_if(pool.begin(), pool.end(), [&](const auto& one) {
        return one.sensor == device + mode.name;
      });
      ASSERT_NE(entry, pool.end()) << device << mode.name;
      if (first.empty()) first = entry->intrinsics;
      ASSERT_EQ(entry->intrinsics.size(), first.size());
      for (std::size_t i = 0; i < first.size(); ++i) {
        const Intrinsics& k = entry->intrinsics[i];
        RequireRays(k, device + mode.name);
        EXPECT_EQ(k.distortion, FindSensorKind(entry->sensor)->lens->distortion);
        EXPECT_NEAR(mode.pixels * k.fx, first[i].fx, 1e-3);
        EXPECT_NEAR(mode.pixels * (k.cx + 0.5) + mode.left, first[i].cx + 0.5 + 192, 1e-3);
        EXPECT_NEAR(mode.pixels * (k.cy + 0.5) + mode.top, first[i].cy + 0.5 + 180, 1e-3);
      }
    }
  }
}

TEST(ParseSensorKinds, AKindIsOneEntry) {
  const std::vector<SensorKind> kinds = ParseSensorKinds(
      "- sensor: other\n  resolution: [4, 3]\n  intrinsics: [[1, 1, 1, 1]]\n"
      "- kind: a\n  principle: stereo\n  lens_sigmas: [0.1, 0.2, 0.3]\n"
      "  errors: {smooth_m: 0.01, smooth_rad: 0.1, seam_reach_m: 0.3, bounce_reach_m: 0.2}\n"
      "- kind: ab\n  like: a\n  errors: {smooth_m: 0.02}\n",
      "own.yaml");
  ASSERT_EQ(kinds.size(), 2U);
  EXPECT_EQ(kinds[1].name, "ab");
  EXPECT_EQ(kinds[1].principle, DepthPrinciple::kStereo);
  EXPECT_EQ(kinds[1].errors.smooth_m, 0.02);
  EXPECT_EQ(kinds[1].errors.smooth_rad, 0.1);
  EXPECT_EQ(kinds[1].lens->sigmas, (std::array<double, 3>{0.1, 0.2, 0.3}));
}

TEST(ParseSensorKinds, RejectsWhatIsNone) {
  const auto expect = [](const std::string& entry, std::initializer_list<std::string> parts) {
    const std::string first =
        "- kind: a\n  errors: {smooth_rad: 0.1, seam_reach_m: 0.3, bounce_reach_m: 0.2}\n";
    ParseSensorKinds(first, "own.yaml");
    ExpectError<ConfigError>([&] { ParseSensorKinds(first + entry, "own.yaml"); }, parts);
  };
  expect("- kind: b\n  like: a\n  erors: {white_m: 1}\n",
         {"unknown key 'erors.white_m'", "own.yaml:5"});
  expect("- kind: b\n  like: c\n", {"like = c", "own.yaml:4"});
  expect("- kind: b\n  like: a\n  principle: radar\n", {"principle", "stereo"});
  expect("- kind: b\n  like: a\n  distortion: [1, 2]\n", {"distortion", "8 numbers"});
  expect("- kind: b\n  like: a\n  errors: {smooth_rad: 0}\n", {"smooth_rad"});
  expect("- kind: b\n", {"smooth_rad"});
}

}  // namespace
}  // namespace volalign::sensor_kind_test

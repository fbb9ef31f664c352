#include "core/geometry/camera.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/lens.h"
#include "core/geometry/sensor_kind.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::camera_test {
namespace {

Intrinsics Example() { return {640, 480, 600, 590, 317.25, 236.5, {}}; }

// A pixel covers [u - 1/2, u + 1/2]: the image's own borders have to stay where they are, so any
// ray's position relative to them scales with the size.
TEST(Intrinsics, ResizedKeepsTheBordersOfTheImage) {
  const Intrinsics full = Example();
  for (const auto& [w, h] : {std::pair(320, 240), {160, 120}, {320, 180}, {1280, 960}, {31, 17}}) {
    const Intrinsics small = full.Resized(w, h);
    EXPECT_EQ(small.width, w);
    EXPECT_EQ(small.height, h);
    for (const double x : {-0.5, 0.0, 0.3}) {
      const double u = full.fx * x + full.cx, v = full.fy * x + full.cy;
      const double su = small.fx * x + small.cx, sv = small.fy * x + small.cy;
      EXPECT_NEAR((su + 0.5) / w, (u + 0.5) / 640, 1e-12);
      EXPECT_NEAR((sv + 0.5) / h, (v + 0.5) / 480, 1e-12);
    }
  }
  const Intrinsics half = full.Resized(320, 240);
  EXPECT_DOUBLE_EQ(half.cx, (317.25 + 0.5) / 2 - 0.5);
  EXPECT_DOUBLE_EQ(half.fy, 295);
  EXPECT_TRUE(full.Resized(640, 480) == full);
}

TEST(Intrinsics, TurnedIsTheCameraOfTheTurnedImage) {
  const Intrinsics full{33, 21, 30.5, 29.25, 15.1, 11.7, {0.2, -0.1, 0.03, -0.02, 0.05}};
  for (int turns = -1; turns < 5; ++turns) {
    const Intrinsics turned = full.Turned(turns);
    // A mark at a pixel, and where it is in the turned image.
    for (const auto& [u, v] : std::vector<std::pair<int, int>>{{3, 4}, {30, 2}, {17, 20}}) {
      Image<int> mark(33, 21);
      mark(u, v) = 1;
      const Image<int> image = Turn(mark, turns);
      ASSERT_EQ(turned.width, image.width());
      const auto at = std::find(image.begin(), image.end(), 1) - image.begin();
      const Eigen::Vector2d ray = ComputeRays(full).at(u, v).cast<double>();
      const double angle = turns * M_PI / 2;
      const Eigen::Vector2d turned_ray(std::cos(angle) * ray.x() - std::sin(angle) * ray.y(),
                                       std::sin(angle) * ray.x() + std::cos(angle) * ray.y());
      const Eigen::Vector2d pixel = ProjectRay(turned, turned_ray);
      const auto column = at % image.width(), row = at / image.width();
      EXPECT_NEAR(pixel.x(), static_cast<double>(column), 1e-4) << turns;
      EXPECT_NEAR(pixel.y(), static_cast<double>(row), 1e-4) << turns;
    }
  }
}

TEST(Intrinsics, ValidateNamesWhatIsWrong) {
  Example().Validate("a");
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  const auto expect_bad = [](const Intrinsics& k, const std::string& part) {
    ExpectError<DataError>([&] { k.Validate("sensor KA03"); }, {"sensor KA03", part});
  };
  expect_bad({0, 480, 600, 590, 317, 236, {}}, "0x480");
  expect_bad({640, -3, 600, 590, 317, 236, {}}, "640x-3");
  for (const double f : {0.0, -600.0, nan, inf}) {
    expect_bad({640, 480, f, 590, 317, 236, {}}, "fx");
    expect_bad({640, 480, 600, f, 317, 236, {}}, "fy");
  }
  for (const double c : {-641.0, 1281.0, nan, inf, -inf}) {
    expect_bad({640, 480, 600, 590, c, 236, {}}, "principal point");
    expect_bad({640, 480, 600, 590, 317, c, {}}, "principal point");
  }
  Intrinsics k = Example();
  k.width = k.height = std::numeric_limits<int>::max();
  k.Validate("a");
  for (const std::size_t n : {1u, 2u, 3u, 6u, 7u, 9u, 12u}) {
    k = Example();
    k.distortion.assign(n, 0.0);
    expect_bad(k, std::to_string(n) + " distortion");
  }
  for (const std::size_t n : {0u, 4u, 5u, 8u}) {
    k = Example();
    k.distortion.assign(n, 0.01);
    k.Validate("a");
    if (n == 0) continue;
    k.distortion.back() = nan;
    expect_bad(k, "distortion");
  }
}

// Numbers copied by hand from the list of measured intrinsics.
TEST(IntrinsicsPool, ReadsTheShippedPool) {
  const auto pool = ReadIntrinsicsPool("configs/intrinsics.yaml");
  for (const auto& entry : pool) {
    for (const auto& k : entry.intrinsics) {
      EXPECT_EQ(k.width, entry.intrinsics[0].width);
      EXPECT_EQ(k.height, entry.intrinsics[0].height);
    }
  }
  const double focal = 939.235107421875;
  const std::vector<double> lens = {0.92185, 0.50040, 0, 0, 0.02836, 1.25842, 0.75181, 0.14419};
  const Intrinsics d415{1280, 720, focal, focal, 639.2382202148438, 350.4108581542969, {}};
  const Intrinsics azure{320, 288, 252.2103, 252.2250, 167.5221, 170.2071, lens};
  EXPECT_TRUE(pool[0].intrinsics[1] == d415);
  EXPECT_TRUE(pool[4].intrinsics[2] == azure);
}

// config_test has what every reader rejects.
TEST(IntrinsicsPool, RejectsBadFiles) {
  const TempFolder folder;
  const std::string path = (folder / "pool.yaml").string();
  const auto expect_bad = [&](const std::string& text, std::initializer_list<std::string> parts) {
    folder.Write("pool.yaml", text);
    SCOPED_TRACE(text);
    ExpectError<ConfigError>([&] { ReadIntrinsicsPool(path); }, parts);
  };
  const std::string head = "- sensor: a\n  resolution: [640, 480]\n  intrinsics:\n";
  expect_bad("", {path});
  expect_bad("- resolution: [640, 480]\n  intrinsics: [[1, 1, 1, 1]]\n", {path});
  expect_bad("- sensor: a\n  resolution: [640, 480]\n", {path, "'intrinsics' is missing"});
  expect_bad(head + "    - [600, 600, 320]\n",
             {path + ":4", "intrinsics[0] = [600, 600, 320] has 3 values; 4"});
  expect_bad(head + "    - [0, 600, 320, 240]\n", {path + ":4", "fx = 0"});
  expect_bad(head + "    - [600, 600, 3200, 240]\n", {path + ":4", "principal point"});
  expect_bad("- sensor: a\n  resolution: [-640, 480]\n  intrinsics: [[600, 600, 320, 240]]\n",
             {path + ":3", "-640x480"});
  expect_bad(
      "- sensor: a\n  resolution: [640, 480]\n  distortion: [0.1, 0.2]\n  intrinsics:\n"
      "    - [600, 600, 320, 240]\n",
      {path + ":5", "2 distortion coefficients", "0, 4, 5 or 8"});
  ExpectError<IoError>([&] { ReadIntrinsicsPool((folder / "missing.yaml").string()); },
                       {"missing.yaml"});
}

/// OpenCV's documented model, written out term by term; shares no code with the library.
Eigen::Vector2d Project(const Intrinsics& k, double x, double y) {
  const auto d = [&](std::size_t i) { return i < k.distortion.size() ? k.distortion[i] : 0.0; };
  const double k1 = d(0), k2 = d(1), p1 = d(2), p2 = d(3), k3 = d(4), k4 = d(5), k5 = d(6),
               k6 = d(7);
  const double r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
  const double f = (1 + k1 * r2 + k2 * r4 + k3 * r6) / (1 + k4 * r2 + k5 * r4 + k6 * r6);
  const double xd = x * f + 2 * p1 * x * y + p2 * (r2 + 2 * x * x);
  const double yd = y * f + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y;
  return {k.fx * xd + k.cx, k.fy * yd + k.cy};
}

Intrinsics Camera(std::vector<double> distortion) {
  return {320, 288, 252.4, 251.9, 163.2, 165.7, std::move(distortion)};
}

TEST(Lens, RaysProjectBackToTheirPixels) {
  const std::vector<std::vector<double>> lenses = {
      {},
      {-0.11, 0.03, 0.0007, -0.0004},
      {0.08, -0.12, -0.0006, 0.0009, 0.03},
      {0.45, -0.06, 0.00005, -0.00007, -0.003, 0.55, -0.02, -0.005},
      // Two factory calibrations of Azure Kinects, and the first with a strong tangential part.
      {0.92185, 0.50040, 0, 0, 0.02836, 1.25842, 0.75181, 0.14419},
      {4.72474, 3.20922, 0, 0, 0.17060, 5.05586, 4.77578, 0.88649},
      {0.92185, 0.50040, 0.01, -0.008, 0.02836, 1.25842, 0.75181, 0.14419}};
  for (const auto& lens : lenses) {
    const Intrinsics k = Camera(lens);
    const RayTable table = ComputeRays(k);
    ASSERT_EQ(table.width, k.width);
    ASSERT_EQ(table.height, k.height);
    for (const auto [u, v] : Pixels(k.width, k.height)) {
      const Eigen::Vector2d p = Project(k, table.at(u, v).x(), table.at(u, v).y());
      ASSERT_LT((ProjectRay(k, table.at(u, v).cast<double>()) - p).norm(), 1e-9);
      const double error = std::hypot(p.x() - u, p.y() - v);
      // Float rays: 1e-7 of a focal length.
      ASSERT_FALSE(!(error <= 1e-4)) << lens.size() << " coefficients, pixel " << u << " " << v;
    }
  }
}

TEST(Lens, PixelsBeyondTheFoldHaveNoRay) {
  // r (1 - 0.5 r^2) grows up to r = 0.8165 only, to 0.5443: farther pixels belong to no ray, or to
  // one beyond the fold.
  const Intrinsics k = Camera({-0.5, 0, 0, 0});
  const RayTable table = ComputeRays(k);
  int with = 0, without = 0;
  for (const auto [u, v] : Pixels(k.width, k.height)) {
    const double radius = std::hypot((u - k.cx) / k.fx, (v - k.cy) / k.fy);
    if (radius < 0.544) {
      ASSERT_LT(table.at(u, v).norm(), 0.8165) << u << " " << v;
      ++with;
    }
    if (radius > 0.545) {
      ASSERT_FALSE(table.at(u, v).allFinite()) << u << " " << v;
      ++without;
    }
  }
  EXPECT_GT(with, 1000);
  EXPECT_GT(without, 1000);
}

TEST(Lens, CoefficientsThatCannotBeInvertedAreAnError) {
  ExpectError<DataError>([] { ComputeRays(Camera({-9.0, 0, 0, 0})); }, {"distortion", "k1 k2 p1"});
  ExpectError<DataError>([] { ComputeRays(Camera({0.1, 0.1})); }, {"2 distortion coefficients"});
  // Orbbec's order, k1 ... k6 p1 p2, of a Femto Bolt: OpenCV's is another one.
  const std::vector<double> orbbec = {16.1704, 8.44953, 0.324469,    16.4805,
                                      13.9441, 1.99604, 5.92792e-05, -1.46558e-05};
  ExpectError<DataError>([&] { RequireRays(Camera(orbbec), "S1.json"); },
                         {"S1.json: ", "% of the picture", "k1 k2 p1"});
  RequireRays(
      Camera({16.1704, 8.44953, 5.92792e-05, -1.46558e-05, 0.324469, 16.4805, 13.9441, 1.99604}),
      "S1.json");
}

// The axis is at the top of the picture, so that the share of pixels beyond the fold, which the
// message gives, depends on where each row is taken to be.
TEST(Lens, TheShareWithoutRaysIsThePictures) {
  Intrinsics k = Camera({-0.5, 0, 0, 0});
  k.cy = -0.5;
  const double reach = std::sqrt(2.0 / 3) * 2 / 3;  // where r (1 - 0.5 r^2) is largest
  double beyond = 0;
  for (const auto [u, v] : Pixels(k.width, k.height))
    beyond += std::hypot((u - k.cx) / k.fx, (v - k.cy) / k.fy) > reach;
  const std::string message = ExpectError<DataError>([&] { RequireRays(k, "S1"); });
  const std::size_t at = message.find("inverted at ");
  ASSERT_NE(at, std::string::npos) << message;
  EXPECT_NEAR(std::stod(message.substr(at + 12)), 100 * beyond / (k.width * k.height), 1);
}

TEST(FindSensorKind, IsTheOneWithTheLongestNameThatItBeginsWith) {
  const SensorKind* azure = FindSensorKind("azure_kinect_nfov_binned");
  ASSERT_NE(azure, nullptr);
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

// One design: units of it differ in scale by more than any other kind's.
TEST(SensorKinds, TheFirstKinectsDesignHasThreeNames) {
  const DepthErrorModel& kinect = ErrorsOf("kinect_v1");
  EXPECT_GT(kinect.unit_gain, 3 * ErrorsOf("realsense_d415").unit_gain);
  EXPECT_EQ(ErrorsOf("azure_kinect_nfov_binned").unit_gain, ErrorsOf("").unit_gain);
  for (const char* name : {"asus_xtion", "asus_xtion_pro_live", "primesense_carmine"}) {
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
      "- kind: a\n  lens_sigmas: [0.1, 0.2, 0.3]\n"
      "  errors: {smooth_m: 0.01, smooth_rad: 0.1, seam_reach_m: 0.3, bounce_reach_m: 0.2}\n"
      "- kind: ab\n  like: a\n  errors: {smooth_m: 0.02}\n",
      "own.yaml");
  ASSERT_EQ(kinds.size(), 2U);
  EXPECT_EQ(kinds[1].name, "ab");
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
  expect("- kind: b\n  like: c\n", {"like = c", "own.yaml:4"});
  expect("- kind: b\n  like: a\n  distortion: [1, 2]\n", {"distortion", "8 numbers"});
  expect("- kind: b\n  like: a\n  errors: {smooth_rad: 0}\n", {"smooth_rad"});
  expect("- kind: b\n", {"smooth_rad"});
}

}  // namespace
}  // namespace volalign::camera_test

#include "core/geometry/camera.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/image.h"
#include "core/geometry/lens.h"
#include "tests/core/base/expect_error.h"
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

TEST(Intrinsics, FourTurnsAreNone) {
  const Intrinsics full = Example();
  EXPECT_TRUE(full.Turned(4) == full);
  EXPECT_TRUE(full.Turned(1).Turned(-1) == full);
  EXPECT_TRUE(full.Turned(1).Turned(1) == full.Turned(2));
  EXPECT_FALSE(full.Turned(1) == full);
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
  Intrinsics k = Example();
  k.width = 0;
  expect_bad(k, "0x480");
  k = Example();
  k.height = -3;
  expect_bad(k, "640x-3");
  for (const double f : {0.0, -600.0, nan, inf}) {
    k = Example();
    k.fx = f;
    expect_bad(k, "fx");
    k = Example();
    k.fy = f;
    expect_bad(k, "fy");
  }
  for (const double c : {-641.0, 1281.0, nan, inf, -inf}) {
    k = Example();
    k.cx = c;
    expect_bad(k, "principal point");
    k = Example();
    k.cy = c;
    expect_bad(k, "principal point");
  }
  k = Example();
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
  std::map<std::string, std::size_t> counts;
  std::map<std::string, std::size_t> lens_of = {{"kinect_v2", 5}};
  for (const auto& entry : pool) {
    counts[entry.sensor] += entry.intrinsics.size();
    for (const auto& k : entry.intrinsics) {
      EXPECT_EQ(k.width, entry.intrinsics[0].width);
      EXPECT_EQ(k.height, entry.intrinsics[0].height);
      const bool wide = entry.sensor.rfind("azure", 0) == 0 || entry.sensor.rfind("orbbec", 0) == 0;
      EXPECT_EQ(k.distortion.size(), wide ? 8 : lens_of[entry.sensor]);
    }
  }
  std::map<std::string, std::size_t> expected = {{"realsense_d415", 4}, {"realsense_d435", 2},
                                                 {"realsense_d455", 1}, {"kinect_v1", 7},
                                                 {"kinect_v2", 4},      {"oak_d", 1}};
  for (const std::string mode : {"nfov_binned", "nfov_unbinned", "wfov_binned", "wfov_unbinned"}) {
    expected["azure_kinect_" + mode] = 6;
    for (const std::string device : {"bolt_", "mega_"})
      expected["orbbec_femto_" + device + mode] = 2;
  }
  EXPECT_EQ(counts, expected);
  EXPECT_TRUE(pool[0].intrinsics[1] == (Intrinsics{1280,
                                                   720,
                                                   939.235107421875,
                                                   939.235107421875,
                                                   639.2382202148438,
                                                   350.4108581542969,
                                                   {}}));
  EXPECT_TRUE(pool[4].intrinsics[2] ==
              (Intrinsics{320,
                          288,
                          252.2103,
                          252.2250,
                          167.5221,
                          170.2071,
                          {0.92185, 0.50040, 0, 0, 0.02836, 1.25842, 0.75181, 0.14419}}));
}

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
  expect_bad("[]", {path});
  expect_bad("just words", {path});
  expect_bad("a: 1", {path});
  expect_bad("- sensor: [", {path});
  expect_bad("- resolution: [640, 480]\n  intrinsics: [[1, 1, 1, 1]]\n", {path});
  expect_bad("- sensor: a\n  intrinsics: [[1, 1, 1, 1]]\n", {path});
  expect_bad("- sensor: a\n  resolution: [640]\n  intrinsics: [[1, 1, 1, 1]]\n",
             {path + ":2", "resolution = [640] has 1 values; 2 are expected"});
  expect_bad("- sensor: a\n  resolution: [640, 480]\n", {path, "'intrinsics' is missing"});
  expect_bad(head + "    - [600, 600, 320]\n",
             {path + ":4", "intrinsics[0] = [600, 600, 320] has 3 values; 4"});
  expect_bad(head + "    - [600, 600, 320, 240]\n    - [600, wide, 320, 240]\n", {path + ":5"});
  expect_bad(head + "    - [0, 600, 320, 240]\n", {path + ":4", "fx = 0"});
  expect_bad(head + "    - [600, 600, 3200, 240]\n", {path + ":4", "principal point"});
  expect_bad("- sensor: a\n  resolution: [-640, 480]\n  intrinsics: [[600, 600, 320, 240]]\n",
             {path + ":3", "-640x480"});
  expect_bad(
      "- sensor: a\n  resolution: [640, 480]\n  distortion: [0.1, 0.2]\n  intrinsics:\n"
      "    - [600, 600, 320, 240]\n",
      {path + ":5", "2 distortion coefficients", "0, 4, 5 or 8"});
  expect_bad("- sensor: a\n  resolution: [640, 480]\n  distortion: strong\n",
             {path + ":3", "distortion wants a list"});
  const std::string good = head + "    - [600, 600, 320, 240]\n";
  expect_bad(good + "  distorsion: [0.1]\n", {"'distorsion'", path + ":5"});
  expect_bad(good + "  resolutions: [640, 480]\n",
             {"'resolutions'", path + ":5", "did you mean 'resolution'?"});
  expect_bad(good + "  sensor: b\n", {"'sensor' stands twice", path + ":5"});
  ExpectError<IoError>([&] { ReadIntrinsicsPool((folder / "missing.yaml").string()); },
                       {"missing.yaml"});
}

}  // namespace
}  // namespace volalign::camera_test

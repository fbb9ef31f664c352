#include "core/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>

#include "core/error.h"
#include "tests/core/expect_error.h"
#include "tests/core/temp_folder.h"

namespace volalign {
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
  Intrinsics distorted = full;
  distorted.distortion = {0.1, 0, 0, 0};
  ExpectError<DataError>([&] { distorted.Turned(1); }, {"distortion"});
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

TEST(PinholeRays, ProjectBackToTheirPixels) {
  const Intrinsics k{33, 21, 30.5, 29.25, 15.1, 11.7, {}};
  const RayTable table = PinholeRays(k);
  ASSERT_EQ(table.width, 33);
  ASSERT_EQ(table.height, 21);
  ASSERT_EQ(table.rays.size(), 33u * 21u);
  for (int v = 0; v < 21; ++v) {
    for (int u = 0; u < 33; ++u) {
      EXPECT_NEAR(k.fx * table.at(u, v).x() + k.cx, u, 1e-5);
      EXPECT_NEAR(k.fy * table.at(u, v).y() + k.cy, v, 1e-5);
    }
  }
  Intrinsics distorted = k;
  distorted.distortion = {0.1, 0, 0, 0};
  ExpectError<DataError>([&] { PinholeRays(distorted); }, {"distortion"});
}

// Numbers copied by hand from the list of measured intrinsics.
TEST(IntrinsicsPool, ReadsTheShippedPool) {
  const auto pool = ReadIntrinsicsPool("configs/intrinsics.yaml");
  ASSERT_EQ(pool.size(), 5u);
  std::map<std::string, std::size_t> counts;
  for (const auto& entry : pool) {
    counts[entry.sensor] += entry.intrinsics.size();
    for (const auto& k : entry.intrinsics) {
      EXPECT_EQ(k.width, entry.intrinsics[0].width);
      EXPECT_EQ(k.height, entry.intrinsics[0].height);
      EXPECT_TRUE(k.distortion.empty());
    }
  }
  const std::map<std::string, std::size_t> expected = {
      {"realsense_d415", 4}, {"kinect_v1", 7}, {"kinect_v2", 4}, {"azure_kinect_nfov_binned", 6}};
  EXPECT_EQ(counts, expected);
  EXPECT_TRUE(pool[0].intrinsics[1] == (Intrinsics{1280,
                                                   720,
                                                   939.235107421875,
                                                   939.235107421875,
                                                   639.2382202148438,
                                                   350.4108581542969,
                                                   {}}));
  EXPECT_TRUE(pool[4].intrinsics[2] ==
              (Intrinsics{320, 288, 252.2103, 252.2250, 167.5221, 170.2071, {}}));
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
             {path + ":2", "[width, height]"});
  expect_bad("- sensor: a\n  resolution: [640, 480]\n", {path, "a has no intrinsics"});
  expect_bad(head + "    - [600, 600, 320]\n", {path + ":4", "[fx, fy, cx, cy]"});
  expect_bad(head + "    - [600, 600, 320, 240]\n    - [600, wide, 320, 240]\n", {path + ":5"});
  expect_bad(head + "    - [0, 600, 320, 240]\n", {path + ":4", "fx = 0"});
  expect_bad(head + "    - [600, 600, 3200, 240]\n", {path + ":4", "principal point"});
  expect_bad("- sensor: a\n  resolution: [-640, 480]\n  intrinsics: [[600, 600, 320, 240]]\n",
             {path + ":3", "-640x480"});
  const std::string good = head + "    - [600, 600, 320, 240]\n";
  expect_bad(good + "  distorsion: [0.1]\n", {"'distorsion'", path + ":5"});
  expect_bad(good + "  resolutions: [640, 480]\n",
             {"'resolutions'", path + ":5", "did you mean 'resolution'?"});
  expect_bad(good + "  sensor: b\n", {"'sensor' stands twice", path + ":5"});
  ExpectError<IoError>([&] { ReadIntrinsicsPool((folder / "missing.yaml").string()); },
                       {"missing.yaml"});
}

}  // namespace
}  // namespace volalign

#include "infer/formats/printed_intrinsics.h"

#include <gtest/gtest.h>

#include <locale>
#include <string>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::formats_internal::printed_intrinsics_test {
namespace {

TEST(FromPyrealsense, TellsFocalLengthsFromThePrincipalPoint) {
  const std::optional<Intrinsics> found = FromPyrealsense(
      "depth: [ 640x480  p[318.5 240.9]  f[383.3 384.4]  Brown Conrady [0.1 0 0 0.2 0] ]", "file");
  ASSERT_TRUE(found);
  EXPECT_EQ(*found, (Intrinsics{640, 480, 383.3, 384.4, 318.5, 240.9, {0.1, 0, 0, 0.2, 0}}));
  EXPECT_FALSE(FromPyrealsense("width: 640", "file"));
  ExpectError<DataError>(
      [] { FromPyrealsense("[ 640x480  p[x 240.9]  f[1 2]  Brown Conrady [0 0 0 0 0] ]", "file"); },
      {"file", "p[...]"});
  ExpectError<DataError>(
      [] { FromPyrealsense("[ 640x480  p[1 2]  f[1 2]  Ftheta [1 0 0 0 0] ]", "file"); },
      {"file", "Ftheta"});
}

/// A decimal comma, and points between thousands.
struct CommaPoint : std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
  char do_thousands_sep() const override { return '.'; }
  std::string do_grouping() const override { return "\3"; }
};

TEST(FromPyrealsense, WhateverTheLocale) {
  const std::locale before = std::locale::global(std::locale(std::locale(), new CommaPoint));
  const auto found = FromPyrealsense(
      "[ 640x480  p[318.500 240.9]  f[383.300 384.4]  Brown Conrady [0.1 0 0 0.2 0] ]", "file");
  std::locale::global(before);
  ASSERT_TRUE(found);
  EXPECT_EQ(*found, (Intrinsics{640, 480, 383.3, 384.4, 318.5, 240.9, {0.1, 0, 0, 0.2, 0}}));
}

// Blanks and brackets without end, which a backtracking search would go through by recursion, or
// from each bracket anew.
TEST(FromPyrealsense, EndsWithAnyText) {
  constexpr std::size_t kLong = 400000;
  std::string brackets;
  for (std::size_t i = 0; i < kLong / 10; ++i) brackets += "[1x1 p[1 1";
  for (const std::string& text : {"[" + std::string(kLong, ' '), std::string(kLong, '['), brackets,
                                  "[1x1  p[1 1] f[1 1] " + std::string(kLong, 'a') + "[0] ]"})
    EXPECT_FALSE(FromPyrealsense(text, "file"));
  ExpectError<DataError>([] { FromPyrealsense("[ 9x9  p[1 2 3]  f[4]  None [0] ]", "file"); },
                         {"two numbers each"});
}

TEST(FromRsEnumerate, EndsWithAnyText) {
  constexpr std::size_t kLong = 400000;
  ExpectError<DataError>(
      [] {
        FromRsEnumerate("Intrinsic of \"Depth\"\n" + std::string(kLong, ' '), "file", {1, 1});
      },
      {"file", "Width is missing"});
}

TEST(FromRsEnumerate, TakesTheDepthStreamOfTheFramesSize) {
  const auto block = [](const std::string& stream, int width, const std::string& fx) {
    return "Intrinsic of \"" + stream + "\" / {Z16}\n  Width: \t" + std::to_string(width) +
           "\n  Height: 480\n  PPX: 319.5\n  PPY: 239.25\n  Fx: " + fx +
           "\n  Fy: 524.25\n  Distortion: Brown Conrady \n  Coeffs: 0.1 0 0 0 0\n\n";
  };
  const std::string text = block("Color", 640, "700") + block("Depth", 848, "600") +
                           block("Depth", 640, "525.5") + block("Infrared", 640, "800");
  const std::optional<Intrinsics> found = FromRsEnumerate(text, "file", {640, 480});
  ASSERT_TRUE(found);
  EXPECT_EQ(*found, (Intrinsics{640, 480, 525.5, 524.25, 319.5, 239.25, {0.1, 0, 0, 0, 0}}));
  EXPECT_EQ(FromRsEnumerate(text, "file", {848, 480})->fx, 600);
  ExpectError<DataError>([&] { FromRsEnumerate(text, "file", {1280, 480}); }, {"file", "1280x480"});
  EXPECT_FALSE(FromRsEnumerate(block("Color", 640, "700"), "file", {640, 480}));
  // A number of a block that has none is not taken from the next one.
  ExpectError<DataError>(
      [&] {
        FromRsEnumerate(block("Depth", 640, "none") + text, "file", {640, 480});
      },
      {"file", "Fx"});
}

TEST(FromPyorbbec, ReordersTheLens) {
  const std::string print =
      "<OBCameraParam depth_intrinsic < fx=504.507 fy=504.528 cx=326.349 cy=343.595 width=640 "
      "height=576 > \n depth_distortion < k1=16.1704 k2=8.44953 k3=0.324469 k4=16.4805 k5=13.9441 "
      "k6=1.99604 p1=5.93e-05 p2=-1.47e-05 > \n rgb_intrinsic < fx=1 fy=1 cx=1 cy=1 width=2 "
      "height=2 > >";
  const auto k = FromPyorbbec(print, "a.txt");
  ASSERT_TRUE(k);
  EXPECT_EQ(k->width, 640);
  EXPECT_EQ(k->cy, 343.595);
  EXPECT_EQ(k->distortion, (std::vector<double>{16.1704, 8.44953, 5.93e-05, -1.47e-05, 0.324469,
                                                16.4805, 13.9441, 1.99604}));
  EXPECT_FALSE(FromPyorbbec("fx: 3", "a.txt"));
  EXPECT_THROW(FromPyorbbec("<OBCameraParam depth_intrinsic < fx=1 >", "a.txt"), DataError);
}

}  // namespace
}  // namespace volalign::formats_internal::printed_intrinsics_test

#include "infer/capture/mean_depth.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "core/base/random.h"

namespace volalign::mean_depth_test {
namespace {

/// The values of one pixel in several files.
SensorFrame MeanOf(const std::vector<float>& values, double scale, bool whole = true) {
  std::vector<StoredDepth> images;
  for (const float value : values) images.push_back({Image<float>(1, 1, value), whole});
  SensorFrame frame;
  frame.depth_scale = scale;
  SetMeanDepth(images, &frame);
  return frame;
}

TEST(SetMeanDepth, OneImageIsTakenAsItIs) {
  SensorFrame frame;
  frame.depth_scale = 0.0001;
  Image<float> values(3, 2);
  for (int i = 0; i < 6; ++i) values[static_cast<std::size_t>(i)] = 1000.0f * static_cast<float>(i);
  SetMeanDepth({{values, true}}, &frame);
  ASSERT_EQ(frame.depth.width(), 3);
  ASSERT_EQ(frame.depth.height(), 2);
  for (int i = 0; i < 6; ++i)
    EXPECT_FLOAT_EQ(frame.depth[static_cast<std::size_t>(i)], 0.1f * static_cast<float>(i));
  EXPECT_TRUE(frame.depth_sigma.empty());
}

// By hand, in millimetres: the median, the deviation that 68 % keep, the mean of the values within
// three of these, and that deviation over the root of the number of values.
TEST(SetMeanDepth, IsTheMeanNearTheMedian) {
  struct Case {
    std::vector<float> values;
    double mean, sigma;
  };
  const Case cases[] = {
      {{1000, 1002, 1004}, 1002, 2 / std::sqrt(3)},
      {{1004, 1000, 1002}, 1002, 2 / std::sqrt(3)},
      {{1000, 1000, 1000, 1000}, 1000, 0.3 / 2},     // rounded to steps
      {{1000, 1000, 1000, 1001}, 1000.25, 0.3 / 2},  // a step is near
      {{1000, 1000, 1000, 1002}, 1000, 0.3 / 2},     // two are not
      {{0, 1500, 0}, 0, 0},                          // what is measured once
      {{0, 0, 0}, 0, 0},
      {{1000, 2000, 1000, 2000, 1000}, 1000, 1000 / std::sqrt(5)},  // of two surfaces the nearer
      {{1000, 2000, 2000, 1000}, 1000, 1000 / 2.0},                 // and of as many of each
      {{1000, 1040, 960, 1050, 950}, 1000, 50 / std::sqrt(5)},      // a jump is 45 mm at 1 m
      {{0, 2000, 2010, 1990, 0}, 2000, 10 / std::sqrt(3)},
  };
  for (const Case& c : cases) {
    const SensorFrame frame = MeanOf(c.values, 0.001);
    EXPECT_NEAR(1000 * frame.depth[0], c.mean, 1e-3) << c.values[0] << " " << c.values[1];
    EXPECT_NEAR(1000 * frame.depth_sigma[0], c.sigma, 1e-3) << c.values[0] << " " << c.values[1];
  }
}

TEST(SetMeanDepth, UnitsAreTheFilesOwn) {
  const SensorFrame fine = MeanOf({10000, 10020, 10040}, 0.0001);
  EXPECT_NEAR(fine.depth[0], 1.002, 1e-6);
  EXPECT_NEAR(fine.depth_sigma[0], 0.002 / std::sqrt(3), 1e-7);
  // Metres are stored as floats: no step of a metre, but one of 0.1 mm.
  const SensorFrame metres = MeanOf({1, 1, 1, 1}, 1, false);
  EXPECT_NEAR(metres.depth_sigma[0], 0.3e-4 / 2, 1e-9);
  EXPECT_NEAR(MeanOf({1, 1.002f, 1.004f}, 1, false).depth[0], 1.002, 1e-6);
}

// The standard error is that of many means of frames with a known error.
TEST(SetMeanDepth, SigmaIsTheStandardError) {
  constexpr int kPixels = 4000, kFrames = 25;
  constexpr double kSigma = 6;  // mm
  RandomStream random(7, 0, "mean depth");
  std::vector<StoredDepth> images;
  for (int k = 0; k < kFrames; ++k) {
    Image<float> values(kPixels, 1);
    for (float& value : values)
      value = static_cast<float>(std::round(2000 + kSigma * random.Normal()));
    images.push_back({values, true});
  }
  SensorFrame frame;
  frame.depth_scale = 0.001;
  SetMeanDepth(images, &frame);
  double squares = 0, stated = 0;
  for (std::size_t i = 0; i < kPixels; ++i) {
    const double error = 1000 * static_cast<double>(frame.depth[i]) - 2000;
    squares += error * error;
    stated += 1e6 * static_cast<double>(frame.depth_sigma[i]) * frame.depth_sigma[i];
  }
  const double actual = std::sqrt(squares / kPixels);
  EXPECT_NEAR(actual, kSigma / std::sqrt(kFrames), 0.05);
  EXPECT_NEAR(std::sqrt(stated / kPixels), actual, 0.1 * actual);
}

TEST(SetMeanDepth, WhatIsMeasuredOnceOrTwiceOfManyIsNot) {
  std::vector<StoredDepth> images;
  for (int k = 0; k < 10; ++k) {
    Image<float> values(3, 1);
    for (std::size_t i = 0; i < 3; ++i) values[i] = k <= static_cast<int>(i) ? 2000.0f : 0.0f;
    images.push_back({values, true});
  }
  SensorFrame frame;
  frame.depth_scale = 0.001;
  SetMeanDepth(images, &frame);
  EXPECT_EQ(frame.depth[0], 0);
  EXPECT_EQ(frame.depth[1], 0);
  EXPECT_NEAR(frame.depth[2], 2, 1e-6);
  SetMeanDepth({images[0], images[1]}, &frame);
  EXPECT_EQ(frame.depth[0], 0);
  EXPECT_NEAR(frame.depth[1], 2, 1e-6);
}

// Beyond the frames that are kept, by the median and the deviation of these.
TEST(MeanDepth, OfManyFramesIsARunningOne) {
  MeanDepth mean(0.001);
  constexpr int kFrames = 200;
  for (int i = 0; i < kFrames; ++i) {
    Image<float> values(3, 1);
    values[0] = static_cast<float>(1995 + 5 * (i % 3));  // 1995, 2000, 2005
    values[1] = i % 4 == 0 ? 5000.0f : 2000.0f;          // a quarter is another surface
    values[2] = i < 100 ? 0.0f : 3000.0f;                // measured late
    mean.Add({values, true});
  }
  SensorFrame frame;
  mean.Set(&frame);
  EXPECT_NEAR(frame.depth[0], 2.0, 1e-4);
  EXPECT_NEAR(frame.depth_sigma[0], 0.005 / std::sqrt(kFrames), 1e-6);
  EXPECT_NEAR(frame.depth[1], 2.0, 1e-6);
  EXPECT_NEAR(frame.depth[2], 3.0, 1e-6);
  EXPECT_NEAR(frame.depth_sigma[2], 0.0003 / std::sqrt(100), 1e-7);
}

}  // namespace
}  // namespace volalign::mean_depth_test

#include "infer/view/sensor_view.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/lens.h"
#include "core/geometry/sensor_kind.h"
#include "infer/view/frames.h"
#include "infer/view/prior_errors.h"
#include "infer/view/segmentation.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::sensor_view_test {
namespace {

using namespace testing_infer;

/// A lens with tangential coefficients too.
Intrinsics Skewed() {
  Intrinsics lens = Kinect();
  lens.fy = 240;
  lens.distortion = {0.12, -0.06, 0.004, -0.006, 0.01};
  return lens;
}

TEST(SensorView, PixelsBeyondTheFoldOfALensHaveNoDepth) {
  // r (1 - 0.5 r^2) rises up to 0.5443.
  const Intrinsics k{320, 288, 252.4, 251.9, 163.2, 165.7, {-0.5, 0, 0, 0}};
  const SensorView view = MakeSensorView(DepthImage(k.width, k.height, 2.0f), k);
  for (const auto [u, v] : Pixels(k.width, k.height)) {
    const double radius = std::hypot((u - k.cx) / k.fx, (v - k.cy) / k.fy);
    if (radius < 0.53 || radius > 0.55) {
      ASSERT_EQ(view.depth(u, v), radius < 0.53 ? 2.0f : 0.0f) << u << " " << v;
    }
    ASSERT_TRUE(view.rays.at(u, v).allFinite());
  }
  EXPECT_EQ(view.ray_areas(0, 0), 0.0f);
  EXPECT_GT(view.ray_areas(163, 165), 0.0f);
}

TEST(SensorView, DropsWhatIsNoMeasurement) {
  DepthImage depth(20, 10, 1.5f);
  depth(3, 4) = -1;
  depth(4, 4) = std::numeric_limits<float>::quiet_NaN();
  depth(5, 4) = std::numeric_limits<float>::infinity();
  const SensorView view = MakeSensorView(depth, Coarse());
  for (const auto [u, v] : Pixels(20, 10))
    EXPECT_EQ(view.depth(u, v), v == 4 && u >= 3 && u <= 5 ? 0.0f : 1.5f) << u << " " << v;
  ExpectError<DataError>([&] { MakeSensorView(DepthImage(10, 20), Coarse()); }, {"10x20", "20x10"});
}

// A plane at 2 m, perpendicular to the axis: each pixel covers 5 cm x 5 cm of it.
TEST(SensorView, PixelAreaIsThatOfTheSurface) {
  const SensorView view = MakeSensorView(DepthImage(20, 10, 2.0f), Coarse());
  for (const int u : {0, 9, 19})
    EXPECT_NEAR(view.PixelArea(u, 3, 2, -Eigen::Vector3d::UnitZ()), 0.0025, 1e-9);
  // Turned by 60 deg about the vertical, a surface on the axis shows half as much of itself.
  const Eigen::Vector3d normal(std::sin(M_PI / 3), 0, -std::cos(M_PI / 3));
  const Intrinsics centred{21, 11, 40, 40, 10, 5, {}};
  const SensorView on_axis = MakeSensorView(DepthImage(21, 11, 2.0f), centred);
  EXPECT_NEAR(on_axis.PixelArea(10, 5, 2, normal), 0.005, 1e-9);
}

// Each pixel's area is that between the rays half a pixel beside it; together they fill what the
// rays of the picture's outline enclose.
TEST(SensorView, AreasOfRaysAreThoseBetweenTheirNeighbours) {
  for (const Intrinsics& lens : {Kinect(), KinectWithLens(), Skewed()}) {
    SCOPED_TRACE(lens.distortion.size());
    const SensorView view = MakeSensorView(DepthImage(lens.width, lens.height, 1.0f), lens);
    const auto cross = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
      return a.x() * b.y() - a.y() * b.x();
    };
    const auto ray = [&](double u, double v) { return RayThroughLens(lens, u, v); };
    double worst = 0, sum = 0, largest = 0;
    for (const auto [u, v] : Pixels(lens.width, lens.height)) {
      const double area = view.ray_areas(u, v);
      sum += area;
      largest = std::max(largest, area * lens.fx * lens.fy);
      if (u % 16 != 0 || v % 16 != 0) continue;
      const double between = cross(ray(u + 0.5, v) - ray(u - 0.5, v),  //
                                   ray(u, v + 0.5) - ray(u, v - 0.5));
      worst = std::max(worst, std::abs(area / between - 1));
    }
    EXPECT_LT(worst, 1e-3);
    if (lens.distortion.size() == 8) {
      EXPECT_GT(largest, 1.75);
    }
    std::vector<Eigen::Vector2d> outline;
    const double right = lens.width - 0.5, bottom = lens.height - 0.5;
    for (double u = -0.5; u < right; ++u) outline.push_back(ray(u, -0.5));
    for (double v = -0.5; v < bottom; ++v) outline.push_back(ray(right, v));
    for (double u = right; u > -0.5; --u) outline.push_back(ray(u, bottom));
    for (double v = bottom; v > -0.5; --v) outline.push_back(ray(-0.5, v));
    double enclosed = 0;
    for (std::size_t i = 0; i < outline.size(); ++i)
      enclosed += cross(outline[i], outline[(i + 1) % outline.size()]) / 2;
    EXPECT_NEAR(sum / enclosed, 1, 1e-4);
  }
}

TEST(SensorView, CorrectedDepthsAreGainAndOffset) {
  DepthImage depth(20, 10, 2.0f);
  depth(1, 1) = 0;
  depth(2, 1) = 0.01f;
  const SensorView view = Corrected(MakeSensorView(depth, Coarse()), 1.01, -0.05);
  EXPECT_FLOAT_EQ(view.depth(0, 0), 1.97f);
  EXPECT_EQ(view.depth(1, 1), 0.0f);  // not measured
  EXPECT_GT(view.depth(2, 1), 0.0f);  // a measurement still
}

TEST(SensorView, DecimationKeepsPointsAndTheirLabels) {
  DepthImage depth(20, 10);
  SegmentationResult segmentation{LabelImage(20, 10), Image<float>(20, 10)};
  for (std::size_t i = 0; i < depth.size(); ++i) {
    depth[i] = 1 + 0.01f * static_cast<float>(i);
    segmentation.labels[i] = static_cast<std::uint8_t>(i % 21);
    segmentation.confidence[i] = 0.001f * static_cast<float>(i);
  }
  const SensorView view = MakeSensorView(depth, Coarse());
  for (const int stride : {1, 2, 3, 7}) {
    const SensorView small = Decimate(view, stride);
    const SegmentationResult labels = Decimate(segmentation, stride);
    int rows = 0;
    for (int v = stride / 2; v < 10; v += stride, ++rows) {
      int columns = 0;
      for (int u = stride / 2; u < 20; u += stride, ++columns) {
        ASSERT_TRUE(small.depth.Contains(columns, rows)) << stride;
        EXPECT_EQ(small.Point(columns, rows), view.Point(u, v)) << stride;
        EXPECT_EQ(labels.labels(columns, rows), segmentation.labels(u, v)) << stride;
        EXPECT_EQ(labels.confidence(columns, rows), segmentation.confidence(u, v)) << stride;
      }
      EXPECT_EQ(small.width(), columns) << stride;
    }
    EXPECT_EQ(small.height(), rows) << stride;
    EXPECT_NEAR(small.ray_areas(0, 0), stride * stride / 1600.0, 1e-8);
  }
}

TEST(StrideForRays, LeavesAtLeastSoMany) {
  EXPECT_EQ(StrideForRays(std::size_t{320} * 288, 10000), 3);
  EXPECT_EQ(StrideForRays(std::size_t{320} * 180, 10000), 2);
  EXPECT_EQ(StrideForRays(9999, 10000), 1);
  EXPECT_EQ(StrideForRays(0, 10000), 1);
  for (std::size_t pixels = 10000; pixels < 1000000; pixels += 7777) {
    const int stride = StrideForRays(pixels, 10000);
    const double left = static_cast<double>(pixels) / (stride * stride);
    const double next = static_cast<double>(pixels) / ((stride + 1) * (stride + 1));
    EXPECT_GE(left, 10000) << pixels;
    EXPECT_LT(next, 10000) << pixels;
  }
}

TEST(PriorErrorsOf, HasTheKindsErrorsButForTheSmoothOne) {
  for (const char* kind : {"realsense_d415", "azure_kinect_nfov_binned", "lidar"}) {
    const DepthErrorModel prior = PriorErrorsOf(kind);
    EXPECT_EQ(prior.Smooth(3), ErrorsOf("lidar").Smooth(3)) << kind;
    EXPECT_EQ(prior.White(3), ErrorsOf(kind).White(3)) << kind;
    EXPECT_EQ(prior.gain, ErrorsOf(kind).gain) << kind;
  }
  EXPECT_LT(PriorErrorsOf("realsense_d415").Smooth(2), ErrorsOf("realsense_d415").Smooth(2));
}

}  // namespace
}  // namespace volalign::sensor_view_test

#include "infer/view/camera_rays.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/error.h"
#include "infer/view/sensor_view.h"
#include "tests/core/expect_error.h"

namespace volalign {
namespace {

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
  Intrinsics k;
  k.width = 320;
  k.height = 288;
  k.fx = 252.4;
  k.fy = 251.9;
  k.cx = 163.2;
  k.cy = 165.7;
  k.distortion = std::move(distortion);
  return k;
}

TEST(CameraRays, ProjectBackToTheirPixels) {
  const std::vector<std::vector<double>> lenses = {
      {},
      {-0.11, 0.03, 0.0007, -0.0004},
      {0.08, -0.12, -0.0006, 0.0009, 0.03},
      // An Azure Kinect's factory calibration has this order of magnitude.
      {0.45, -0.06, 0.00005, -0.00007, -0.003, 0.55, -0.02, -0.005}};
  for (const auto& lens : lenses) {
    const Intrinsics k = Camera(lens);
    const RayTable table = ComputeRays(k);
    ASSERT_EQ(table.width, k.width);
    ASSERT_EQ(table.height, k.height);
    double worst = 0;
    for (int v = 0; v < k.height; ++v) {
      for (int u = 0; u < k.width; ++u) {
        const Eigen::Vector2d p = Project(k, table.at(u, v).x(), table.at(u, v).y());
        const double error = std::hypot(p.x() - u, p.y() - v);
        ASSERT_FALSE(!(error <= 1e-3)) << lens.size() << " coefficients, pixel " << u << " " << v;
        worst = std::max(worst, error);
      }
    }
    EXPECT_LE(worst, 1e-3) << lens.size();
  }
}

TEST(CameraRays, ForwardModelIsTheDocumentedOne) {
  const Intrinsics k = Camera({0.45, -0.06, 0.002, -0.003, -0.003, 0.79, 0.03, -0.013});
  for (const Eigen::Vector2d& ray : {Eigen::Vector2d(0.3, -0.5), Eigen::Vector2d(-0.6, 0.1)}) {
    EXPECT_LT((ProjectRay(k, ray) - Project(k, ray.x(), ray.y())).norm(), 1e-9);
  }
}

TEST(CameraRays, PixelsBeyondTheFoldHaveNoRayAndNoDepth) {
  // r (1 - 0.5 r^2) grows up to r = 0.816 only, to 0.544: farther pixels belong to no ray.
  const Intrinsics k = Camera({-0.5, 0, 0, 0});
  const RayTable table = ComputeRays(k);
  const SensorView view = MakeSensorView(DepthImage(k.width, k.height, 2.0f), k);
  int with = 0, without = 0;
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const double radius = std::hypot((u - k.cx) / k.fx, (v - k.cy) / k.fy);
      if (radius < 0.53) {
        ASSERT_TRUE(table.at(u, v).allFinite()) << u << " " << v;
        EXPECT_EQ(view.depth(u, v), 2.0f);
        ++with;
      }
      if (radius > 0.55) {
        ASSERT_FALSE(table.at(u, v).allFinite()) << u << " " << v;
        EXPECT_EQ(view.depth(u, v), 0.0f);
        ++without;
      }
      ASSERT_TRUE(view.rays.at(u, v).allFinite());
    }
  }
  EXPECT_GT(with, 1000);
  EXPECT_GT(without, 1000);
  ExpectError<DataError>([] { ComputeRays(Camera({-9.0, 0, 0, 0})); }, {"distortion"});
}

}  // namespace
}  // namespace volalign

#include "core/geometry/lens.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::lens_test {
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
  return {320, 288, 252.4, 251.9, 163.2, 165.7, std::move(distortion)};
}

TEST(Lens, ForwardModelIsTheDocumentedOne) {
  for (const std::vector<double>& lens :
       std::vector<std::vector<double>>{{},
                                        {-0.11, 0.03, 0.0007, -0.0004},
                                        {0.08, -0.12, -0.0006, 0.0009, 0.03},
                                        {0.45, -0.06, 0.002, -0.003, -0.003, 0.79, 0.03, -0.013}}) {
    const Intrinsics k = Camera(lens);
    for (const Eigen::Vector2d& ray : {Eigen::Vector2d(0.3, -0.5), Eigen::Vector2d(-0.6, 0.1)}) {
      EXPECT_LT((ProjectRay(k, ray) - Project(k, ray.x(), ray.y())).norm(), 1e-9) << lens.size();
    }
  }
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
    for (int v = 0; v < k.height; ++v) {
      for (int u = 0; u < k.width; ++u) {
        const Eigen::Vector2d p = Project(k, table.at(u, v).x(), table.at(u, v).y());
        const double error = std::hypot(p.x() - u, p.y() - v);
        // Float rays: 1e-7 of a focal length.
        ASSERT_FALSE(!(error <= 1e-4)) << lens.size() << " coefficients, pixel " << u << " " << v;
      }
    }
  }
}

TEST(Lens, OneCurveServesBothFactoryCalibrations) {
  const std::vector<std::pair<double, double>> curve = {{0.2, 0.987}, {0.4, 0.950}, {0.6, 0.898}};
  for (const std::vector<double>& lens : std::vector<std::vector<double>>{
           {0.92185, 0.50040, 0, 0, 0.02836, 1.25842, 0.75181, 0.14419},
           {4.72474, 3.20922, 0, 0, 0.17060, 5.05586, 4.77578, 0.88649}}) {
    const Intrinsics k = Camera(lens);
    for (const auto& [r, factor] : curve) {
      EXPECT_NEAR((ProjectRay(k, {r, 0}).x() - k.cx) / (k.fx * r), factor, 6e-4);
    }
  }
}

TEST(Lens, PixelsBeyondTheFoldHaveNoRay) {
  // r (1 - 0.5 r^2) grows up to r = 0.8165 only, to 0.5443: farther pixels belong to no ray, or to
  // one beyond the fold.
  const Intrinsics k = Camera({-0.5, 0, 0, 0});
  const RayTable table = ComputeRays(k);
  int with = 0, without = 0;
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
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
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      beyond += std::hypot((u - k.cx) / k.fx, (v - k.cy) / k.fy) > reach;
    }
  }
  std::string message;
  try {
    RequireRays(k, "S1");
  } catch (const DataError& error) {
    message = error.what();
  }
  const std::size_t at = message.find("inverted at ");
  ASSERT_NE(at, std::string::npos) << message;
  EXPECT_NEAR(std::stod(message.substr(at + 12)), 100 * beyond / (k.width * k.height), 1);
}

}  // namespace
}  // namespace volalign::lens_test

#include "infer/view/camera_rays.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <vector>

#include "core/error.h"

namespace volalign {

namespace {

/// OpenCV's fixed-point iteration: most steps, and the change that ends it, on the plane z = 1.
constexpr int kFixedPointSteps = 200;
constexpr double kFixedPointChange = 1e-6;
/// Newton steps after it, and the step of their numerical derivatives, on the plane z = 1.
constexpr int kNewtonSteps = 5;
constexpr double kDerivativeStep = 1e-6;
/// A ray has to project back to its pixel within this, px.
constexpr double kMaxErrorPx = 0.01;
/// Nearer to the axis than this, on the plane z = 1, a ray may point to the other side of it.
constexpr double kAxis = 0.05;

}  // namespace

Eigen::Vector2d ProjectRay(const Intrinsics& intrinsics, const Eigen::Vector2d& ray) {
  std::array<double, 8> k{};  // k1 k2 p1 p2 k3 k4 k5 k6
  std::copy(intrinsics.distortion.begin(), intrinsics.distortion.end(), k.begin());
  const double x = ray.x(), y = ray.y(), r2 = x * x + y * y;
  const double radial =
      (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])));
  const double xd = x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x);
  const double yd = y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y;
  return {intrinsics.fx * xd + intrinsics.cx, intrinsics.fy * yd + intrinsics.cy};
}

namespace {

/// Improves a ray by Newton's method, since OpenCV's fixed-point iteration is slow towards the
/// corners of strong lenses. False if the ray does not project back to the pixel, or does so only
/// from beyond the radius at which the lens model folds over.
bool Polish(const Intrinsics& intrinsics, const Eigen::Vector2d& pixel, Eigen::Vector2d* ray) {
  Eigen::Matrix2d jacobian;
  for (int i = 0; i < kNewtonSteps; ++i) {
    for (int axis = 0; axis < 2; ++axis) {
      const Eigen::Vector2d step = kDerivativeStep * Eigen::Vector2d::Unit(axis);
      jacobian.col(axis) =
          (ProjectRay(intrinsics, *ray + step) - ProjectRay(intrinsics, *ray - step)) /
          (2 * kDerivativeStep);
    }
    if (!(jacobian.determinant() > 0)) return false;
    *ray -= jacobian.inverse() * (ProjectRay(intrinsics, *ray) - pixel);
  }
  const Eigen::Vector2d distorted((pixel.x() - intrinsics.cx) / intrinsics.fx,
                                  (pixel.y() - intrinsics.cy) / intrinsics.fy);
  return (ProjectRay(intrinsics, *ray) - pixel).norm() <= kMaxErrorPx &&
         (ray->dot(distorted) > 0 || distorted.norm() < kAxis);
}

}  // namespace

RayTable ComputeRays(const Intrinsics& intrinsics) {
  intrinsics.Validate("ComputeRays");
  if (intrinsics.distortion.empty()) return PinholeRays(intrinsics);

  std::vector<cv::Point2d> pixels, undistorted;
  pixels.reserve(static_cast<std::size_t>(intrinsics.width) *
                 static_cast<std::size_t>(intrinsics.height));
  for (int v = 0; v < intrinsics.height; ++v) {
    for (int u = 0; u < intrinsics.width; ++u) pixels.emplace_back(u, v);
  }
  const cv::Matx33d camera(intrinsics.fx, 0, intrinsics.cx, 0, intrinsics.fy, intrinsics.cy, 0, 0,
                           1);
  cv::undistortPoints(pixels, undistorted, camera, intrinsics.distortion, cv::noArray(),
                      cv::noArray(),
                      cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS,
                                       kFixedPointSteps, kFixedPointChange));

  RayTable table{intrinsics.width, intrinsics.height, {}};
  table.rays.reserve(pixels.size());
  std::size_t lost = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const Eigen::Vector2d pixel(pixels[i].x, pixels[i].y);
    Eigen::Vector2d ray(undistorted[i].x, undistorted[i].y);
    if (Polish(intrinsics, pixel, &ray)) {
      table.rays.push_back(ray.cast<float>());
    } else {
      table.rays.push_back(Eigen::Vector2f::Constant(std::numeric_limits<float>::quiet_NaN()));
      ++lost;
    }
  }
  if (2 * lost > pixels.size()) {
    throw DataError(
        fmt::format("the distortion coefficients cannot be inverted at {} of {} pixels; check "
                    "their order (k1 k2 p1 p2 k3 "
                    "k4 k5 k6) and that they belong to these intrinsics",
                    lost, pixels.size()));
  }
  return table;
}

}  // namespace volalign

// Rays of a camera with a lens against those of OpenCV, whose model captures state.

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <vector>

#include "core/geometry/lens.h"

namespace volalign::opencv_rays_test {
namespace {

class OpencvRays : public testing::TestWithParam<std::vector<double>> {
 protected:
  OpencvRays()
      : intrinsics_{320, 288, 252.4, 251.9, 163.2, 165.7, GetParam()},
        matrix_(252.4, 0, 163.2, 0, 251.9, 165.7, 0, 0, 1) {}

  Intrinsics intrinsics_;
  cv::Matx33d matrix_;
};

TEST_P(OpencvRays, ProjectAsProjectPoints) {
  std::vector<cv::Point3d> points;
  for (double y = -0.6; y <= 0.6; y += 0.1) {
    for (double x = -0.6; x <= 0.6; x += 0.1) points.emplace_back(x, y, 1);
  }
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), matrix_, GetParam(), pixels);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d p = ProjectRay(intrinsics_, {points[i].x, points[i].y});
    EXPECT_NEAR(p.x(), pixels[i].x, 1e-9);
    EXPECT_NEAR(p.y(), pixels[i].y, 1e-9);
  }
}

TEST_P(OpencvRays, RaysAsUndistortPoints) {
  std::vector<cv::Point2d> pixels, rays;
  for (int v = 0; v < intrinsics_.height; ++v) {
    for (int u = 0; u < intrinsics_.width; ++u) pixels.emplace_back(u, v);
  }
  // The iteration is slow towards the corners of a strong lens.
  const cv::TermCriteria until(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 2000, 1e-12);
  cv::undistortPoints(pixels, rays, matrix_, GetParam(), cv::noArray(), cv::noArray(), until);
  const RayTable table = ComputeRays(intrinsics_);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    ASSERT_FALSE(
        !(std::hypot(table.rays[i].x() - rays[i].x, table.rays[i].y() - rays[i].y) <= 2e-7))
        << pixels[i];
  }
}

INSTANTIATE_TEST_SUITE_P(Lenses, OpencvRays,
                         testing::Values(std::vector<double>{-0.11, 0.03, 0.0007, -0.0004},
                                         std::vector<double>{0.09, -0.27, 0.001, -0.002, 0.10},
                                         std::vector<double>{0.92185, 0.50040, 0, 0, 0.02836,
                                                             1.25842, 0.75181, 0.14419},
                                         std::vector<double>{4.72474, 3.20922, 1e-4, -1e-4, 0.17060,
                                                             5.05586, 4.77578, 0.88649}));

}  // namespace
}  // namespace volalign::opencv_rays_test

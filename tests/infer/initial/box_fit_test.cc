#include "infer/initial/box_fit.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/visibility.h"
#include "tests/infer/initial/geometry_frames.h"

namespace volalign::box_fit_test {
namespace {

using testing_infer::Standing;

Structure Stack() {
  return Structure::FromBoxes("stack", {Standing("low", {0.6, 0.3, 0.4}, {0, 0, 0}),
                                        Standing("high", {0.3, 0.4, 0.25}, {0.1, 0.3, -0.05})});
}

const Pose kTruth = testing_infer::RingPose(35, 1.9, 1.1, 20, {0, 0.3, 0});

/// Points on the sides that face the sensor, whatever hides them; `away`: along the normal, m.
std::vector<OrientedPoint> Surface(const Structure& structure, double away = 0) {
  std::vector<OrientedPoint> points;
  for (const Eigen::Vector3d& p : SampleExposedSurface(structure, 0.03)) {
    const Eigen::Vector3d& normal =
        structure.sides()[static_cast<std::size_t>(DistanceToSurface(structure, p).side)].normal;
    if (normal.dot(kTruth.translation() - p) > 0) {
      points.push_back({kTruth.inverse() * (p + away * normal),
                        kTruth.linear().transpose() * normal, 0.03 * 0.03});
    }
  }
  return points;
}

/// The structure moved, and turned about its middle.
Pose Moved(const Eigen::Vector3d& shift, const Eigen::Vector3d& turn) {
  const Eigen::Vector3d middle(0, 0.35, 0);
  Pose moved = Pose::Identity();
  moved.linear() = RotationExp(turn);
  moved.translation() = middle + shift - moved.linear() * middle;
  return moved * kTruth;
}

double Off(const Pose& pose) {
  return (pose * kTruth.inverse())
      .matrix()
      .
      operator-(Eigen::Matrix4d::Identity())
      .cwiseAbs()
      .maxCoeff();
}

TEST(FitToBoxes, BringsPointsOntoTheirSides) {
  RandomStream random(1, 0, "box fit");
  const auto draw = [&](double size) {
    return Eigen::Vector3d{random.Uniform(-size, size), random.Uniform(-size, size),
                           random.Uniform(-size, size)};
  };
  BoxFit fit;
  fit.steps = 30;
  fit.points = 5000;
  for (int k = 0; k < 10; ++k) {
    const Pose start = Moved(draw(0.03), draw(0.05));
    // The least-squares answer is the truth itself, but for the weak prior.
    EXPECT_LT(Off(FitToBoxes(Surface(Stack()), Stack(), fit, start)), 2e-4) << k;
  }
}

TEST(FitToBoxes, StaysAtTheTruth) {
  EXPECT_LT(Off(FitToBoxes(Surface(Stack()), Stack(), BoxFit(), kTruth)), 1e-9);
  // Nothing measured moves nothing.
  EXPECT_LT(Off(FitToBoxes({}, Stack(), BoxFit(), kTruth)), 1e-12);
}

// A third of the points lie 3 cm before their sides: an ordinary mean would be off by 1 cm.
TEST(FitToBoxes, IsRobust) {
  std::vector<OrientedPoint> points = Surface(Stack());
  const std::vector<OrientedPoint> before = Surface(Stack(), 0.03);
  for (std::size_t k = 0; k < points.size(); k += 3) points[k] = before[k];
  BoxFit fit;
  fit.steps = 30;
  fit.last_reach = 0.02;
  EXPECT_LT(Off(FitToBoxes(points, Stack(), fit, kTruth)), 1e-3);
}

TEST(FitToBoxes, LeavesOutWhatFacesElsewhereOrIsFar) {
  std::vector<OrientedPoint> points = Surface(Stack());
  const std::size_t own = points.size();
  for (std::size_t k = 0; k < own; ++k) {
    // On the same places, of surfaces that are turned by 60 deg; and 15 cm away.
    OrientedPoint turned = points[k], far = points[k];
    turned.normal = Eigen::AngleAxisd(M_PI / 3, turned.normal.unitOrthogonal()) * turned.normal;
    turned.p += 0.02 * points[k].normal;
    far.p += 0.15 * points[k].normal;
    points.push_back(turned);
    points.push_back(far);
  }
  BoxFit fit;
  fit.points = 10000;
  // Some of those that are turned face as a neighbouring side does and lie near it.
  EXPECT_LT(Off(FitToBoxes(points, Stack(), fit, kTruth)), 3e-3);
}

// One side, seen head on: it tells its distance and two turns, its border the place along it. Where
// the points end is no border, so that they may slide as long as they stay on the side.
TEST(FitToBoxes, ASidesBorderHoldsItsPoints) {
  const Structure cube =
      Structure::FromBoxes("cube", {Box::FromMinMax("c", {-0.2, 0, -0.2}, {0.2, 0.4, 0.2})});
  std::vector<OrientedPoint> points;
  for (int i = -10; i <= 10; ++i) {
    for (int j = 0; j <= 20; ++j) points.push_back({{0.2, 0.02 * j, 0.02 * i}, {1, 0, 0}, 4e-4});
  }
  BoxFit fit;
  fit.steps = 40;
  fit.points = 10000;
  const auto fitted = [&](const Eigen::Vector3d& shift) -> Eigen::Vector3d {
    return FitToBoxes(points, cube, fit, Pose(Eigen::Translation3d(shift))).translation();
  };
  EXPECT_LT(fitted({0.03, 0, 0}).norm(), 1e-3);
  EXPECT_LT(fitted({0, 0, 0.03}).norm(), 3e-3);
  EXPECT_LT(fitted({0, -0.03, 0}).norm(), 3e-3);
  // Half as wide, they are anywhere on it.
  std::vector<OrientedPoint> some;
  for (const OrientedPoint& point : points) {
    if (std::abs(point.p.z()) < 0.1) some.push_back(point);
  }
  const Pose slid = FitToBoxes(some, cube, fit, Pose(Eigen::Translation3d(0, 0, 0.03)));
  EXPECT_NEAR(slid.translation().z(), 0.03, 1e-3);
}

// The stack hovers 3 cm above the floor that is seen beside it. Its own sides are upright: nothing
// else tells its height.
TEST(FitToBoxes, TheFloorHoldsTheHeight) {
  const Structure cube =
      Structure::FromBoxes("cube", {Box::FromMinMax("c", {-0.2, 0, -0.2}, {0.2, 0.4, 0.2})});
  std::vector<OrientedPoint> points;
  for (int i = -8; i <= 8; ++i) {
    for (int j = 5; j <= 15; ++j) points.push_back({{0.2, 0.02 * j, 0.02 * i}, {1, 0, 0}, 4e-4});
  }
  for (int i = -20; i <= 20; ++i) {
    for (int j = -20; j <= 20; ++j) {
      if (std::max(std::abs(i), std::abs(j)) > 8)
        points.push_back({{0.04 * i, 0, 0.04 * j}, {0, 1, 0}, 16e-4});
    }
  }
  BoxFit fit;
  fit.steps = 30;
  fit.points = 10000;
  const Pose start(Eigen::Translation3d(0, 0.03, 0));
  EXPECT_NEAR(FitToBoxes(points, cube, fit, start).translation().y(), 0.03, 1e-3);
  fit.floor = true;
  EXPECT_NEAR(FitToBoxes(points, cube, fit, start).translation().y(), 0, 1e-3);
}

}  // namespace
}  // namespace volalign::box_fit_test

#include "core/geometry/frame_errors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "core/base/random.h"
#include "core/geometry/sensor_kind.h"
#include "core/geometry/structure.h"

namespace volalign {
namespace {

const Side& SideNamed(const Structure& structure, const std::string& name) {
  for (const Side& side : structure.sides()) {
    if (side.name == name) return side;
  }
  throw std::runtime_error(name);
}

TEST(SeamDistance, IsToWhereSurfacesMeetAtAnInwardCorner) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  const auto side = [&](const char* name) -> const Side& { return SideNamed(structure, name); };
  // The bottom box's front stands on the floor (y = -0.81).
  const Side& front = side("bottom/front");
  for (const double height : {0.0, 0.15, 0.36})
    EXPECT_NEAR(SeamDistance(structure, front, {0.275, -0.81 + height, 0}), height, 1e-9);
  // On its top, beside the next box, which ends at x = 0.05.
  EXPECT_NEAR(SeamDistance(structure, side("bottom/up"), {0.11, -0.405, 0}), 0.06, 1e-9);
  // The top box's front: the bottom box rises before it, and ends at y = -0.405. Before its top,
  // nothing does.
  EXPECT_NEAR(SeamDistance(structure, side("top/front"), {0.05, 0.6, 0}), 1.005, 1e-9);
  EXPECT_EQ(SeamDistance(structure, side("top/up"), {0.05, 0.81, 0}), kNoSeam);
}

// A point at 4 m of a stereo camera, whose errors grow with the square of the depth.
TEST(FrameErrors, GrowFromTheMiddleOfThePicture) {
  const DepthErrorModel errors = ErrorsOf("realsense_d415");
  const Eigen::Vector3d p(1.2, -0.8, 4), faced = -p.normalized();
  const FrameErrorVector at = FrameErrorsAt(errors, p, faced);
  EXPECT_TRUE(at.head<3>().isApprox(4 * Eigen::Vector3d(0.3, -0.2, -0.06), 1e-12))
      << at.transpose();
  EXPECT_TRUE(FrameErrorsAt(errors, {0, 0, 4}, -Eigen::Vector3d::UnitZ()).isZero());
  const FrameErrorVector sigmas = FrameErrorSigmas(errors);
  EXPECT_EQ(sigmas[kTiltRows], errors.tilt_m);
  EXPECT_EQ(sigmas[kTiltColumns], errors.tilt_m);
  EXPECT_EQ(sigmas[kTwist], errors.twist_m);
  EXPECT_EQ(sigmas[kShear], errors.shear_m);
  EXPECT_EQ(sigmas[kBounced], 0);
  const DepthErrorModel tof = ErrorsOf("azure_kinect_nfov_binned");
  EXPECT_NEAR(FrameErrorSigmas(tof)[kBounced], 2 / std::sqrt(3) * tof.bounce_m, 1e-12);
}

// Two pictures of a texture without direction on a slanted plane, of which the right one is a row
// fraction lower: the shift along the row that makes them most alike, in least squares of the
// brightness: over many points and directions, -d sum(g_x g_y) / sum(g_x g_x).
TEST(FrameErrors, ShearIsTheShiftThatMatchesRowsThatDoNotMeet) {
  DepthErrorModel errors;
  errors.smooth_rad = errors.seam_reach_m = errors.bounce_reach_m = 1;
  RandomStream random(3, 0, "shear");
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::Vector3d ray(random.Uniform(-0.5, 0.5), random.Uniform(-0.4, 0.4), 1);
    const Eigen::Vector3d normal =
        Eigen::Vector3d(random.Normal(0, 0.4), random.Normal(0, 0.4), -1).normalized();
    const Eigen::Vector3d along_u = normal.unitOrthogonal(), along_v = normal.cross(along_u);
    const Eigen::Vector3d p = 2 * ray;
    const auto on_plane = [&](double x, double y) -> Eigen::Vector2d {
      const Eigen::Vector3d other(ray.x() + x, ray.y() + y, 1);
      const Eigen::Vector3d q = normal.dot(p) / normal.dot(other) * other;
      return {along_u.dot(q), along_v.dot(q)};
    };
    constexpr double kStep = 1e-5;
    const Eigen::Vector2d by_x = (on_plane(kStep, 0) - on_plane(-kStep, 0)) / (2 * kStep);
    const Eigen::Vector2d by_y = (on_plane(0, kStep) - on_plane(0, -kStep)) / (2 * kStep);
    double xy = 0, xx = 0;
    for (int k = 0; k < 360; ++k) {  // a gradient of every direction on the plane
      const Eigen::Vector2d gradient(std::cos(k * M_PI / 180), std::sin(k * M_PI / 180));
      xy += gradient.dot(by_x) * gradient.dot(by_y);
      xx += gradient.dot(by_x) * gradient.dot(by_x);
    }
    EXPECT_NEAR(FrameErrorsAt(errors, p, normal)[kShear], xy / xx, 1e-6);
  }
}

TEST(BouncedShare, IsMostAtItsReachAndGrowsWithTheSlant) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  const Side& front = SideNamed(structure, "bottom/front");
  const double floor = structure.FloorHeight();
  const auto share = [&](double height, const Eigen::Vector3d& eye) {
    return BouncedShare(structure, front, {0.275, floor + height, 0}, eye, 0.2);
  };
  // From afar at 45 deg, where floor and side are lit and seen alike, and cosines cancel out.
  const Eigen::Vector3d afar = 1e6 * Eigen::Vector3d(1, 1, 0);
  EXPECT_EQ(share(0, afar), 0) << "both ways are as long at the seam";
  EXPECT_NEAR(share(0.2, afar), 1, 1e-3);
  for (const double height : {0.05, 0.15, 0.25, 0.4}) EXPECT_LT(share(height, afar), 0.99);
  EXPECT_NEAR(share(0.1, afar), 0.5 * std::exp(0.5), 1e-3);
  // The floor is lit by the sine of the sensor's elevation, the side is seen at the cosine.
  const double low = M_PI / 9;
  EXPECT_NEAR(share(0.2, 1e6 * Eigen::Vector3d(std::cos(low), std::sin(low), 0)), std::tan(low),
              1e-3);
  // A lamp below the floor lights none of it, and a side is seen at kGrazing at the least.
  EXPECT_EQ(share(0.2, {1e6, -1e6, 0}), 0);
  EXPECT_NEAR(share(0.2, {0.275, 1000, 0}), 1 / kGrazing, 1e-2);
}

TEST(BouncedShare, AddsWhatTheFloorAndBoxesThrow) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  // Before the front of the second box the first one rises, and is lit from above alone; the floor
  // is 40 cm below it.
  const Side& front = SideNamed(structure, "mid_bottom/front");
  const Eigen::Vector3d q(0.05, -0.405 + 0.15, 0), eye(1000, 1000, 0);
  const double floor = 0.555 / 0.2 * std::exp(1 - 0.555 / 0.2);
  EXPECT_NEAR(BouncedShare(structure, front, q, eye, 0.2), 1 + floor, 1e-3);
  // The floor has light of the box that stands on it, and a top none where nothing rises.
  EXPECT_NEAR(BouncedShare(structure, FloorOf(structure), {0.275 + 0.15, -0.81, 0}, eye, 0.2), 1,
              0.05);
  EXPECT_EQ(BouncedShare(structure, SideNamed(structure, "top/up"), {0.05, 0.81, 0}, eye, 0.2), 0);
  // A top before a box has more than the floor has there.
  const Side top = SideNamed(structure, "bottom/up");
  Side floor_there = top;
  floor_there.box = -1;
  const Eigen::Vector3d before(0.05 + 0.15, -0.405, 0);
  const double share = BouncedShare(structure, floor_there, before, eye, 0.2);
  EXPECT_NEAR(share, 1, 0.01);
  EXPECT_NEAR(BouncedShare(structure, top, before, eye, 0.2), 1.3 * share, 1e-9);
}

}  // namespace
}  // namespace volalign

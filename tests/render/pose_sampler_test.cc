#include "render/pose_sampler.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "core/base/error.h"

namespace volalign::pose_sampler_test {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180;

TEST(PoseSamplerTest, StaysWithinThePapersRanges) {
  PoseConfig config;
  config.roll_offsets_deg = {0, 90, 180, 270};
  std::array<int, 4> offsets{};
  for (std::uint64_t i = 0; i < 2000; ++i) {
    RandomStream random(11, i, "pose");
    const Pose pose = SamplePose(config, random);
    const Eigen::Vector3d t = pose.translation();
    const double rho = std::hypot(t.x(), t.z());
    EXPECT_GE(rho, 1.50 - 1e-9);
    EXPECT_LE(rho, 2.75 + 1e-9);
    EXPECT_GE(t.y(), -0.15 - 1e-9);
    EXPECT_LE(t.y(), 0.75 + 1e-9);
    EXPECT_NEAR(pose.linear().determinant(), 1, 1e-9);
    // The optical axis passes the ball of look-at points.
    const Eigen::Vector3d axis = pose.linear().col(2);
    EXPECT_LE((t - t.dot(axis) * axis).norm(), 0.20 + 1e-9);
    EXPECT_LT(t.dot(axis), 0);
    // Roll: angle by which image -y (0), +x (90), +y (180), -x (270) ... miss the vertical. Down in
    // the image plane is at -roll from the image's y axis.
    const Eigen::Vector3d down = pose.linear().transpose() * Eigen::Vector3d(0, -1, 0);
    double roll = std::atan2(down.x(), down.y()) / kDegree;
    if (roll < -45) roll += 360;
    const int offset = static_cast<int>(std::lround(roll / 90)) % 4;
    ++offsets[static_cast<std::size_t>(offset)];
    EXPECT_LE(std::abs(roll - 90 * std::lround(roll / 90)), 5 + 1e-6);
  }
  for (const int count : offsets) EXPECT_NEAR(count, 500, 100);  // 5 sigma
}

TEST(PoseSamplerTest, IsUniformInCylinderAndBall) {
  PoseConfig config;
  config.roll_deg = 0;
  config.rho_cm = {100, 300};
  constexpr int kCount = 4000;
  double mean_rho = 0, mean_height = 0, miss = 0;
  std::array<int, 8> octants{};
  for (std::uint64_t i = 0; i < kCount; ++i) {
    RandomStream random(12, i, "pose");
    const Pose pose = SamplePose(config, random);
    const Eigen::Vector3d t = pose.translation();
    mean_rho += std::hypot(t.x(), t.z()) / kCount;
    mean_height += t.y() / kCount;
    const double phi = std::atan2(t.z(), t.x()) / kDegree + 180;
    ++octants[std::min<std::size_t>(static_cast<std::size_t>(phi / 45), 7)];
    const Eigen::Vector3d axis = pose.linear().col(2);
    miss += (t - t.dot(axis) * axis).squaredNorm() / kCount;
  }
  EXPECT_NEAR(mean_rho, 2.0, 5 * 2.0 / std::sqrt(12.0 * kCount));
  EXPECT_NEAR(mean_height, 0.30, 5 * 0.9 / std::sqrt(12.0 * kCount));
  for (const int count : octants) EXPECT_NEAR(count, kCount / 8.0, 5 * std::sqrt(kCount / 8.0));
  // A ball of radius r seen from afar: mean squared distance from the axis is 2/5 r^2.
  EXPECT_NEAR(miss, 0.4 * 0.04, 0.002);
}

TEST(PoseSamplerTest, StaysAroundFixedPlacements) {
  PoseConfig config;
  config.rho_cm = {180, 200};
  config.height_cm = {10, 40};
  config.phi_deg = {45, 135, 225, 315};
  config.phi_jitter_deg = 10;
  constexpr int kCount = 4000;
  std::array<int, 4> placements{};
  std::array<int, 4> quarters{};  // of the deviation's range
  for (std::uint64_t i = 0; i < kCount; ++i) {
    RandomStream random(13, i, "pose");
    const Eigen::Vector3d t = SamplePose(config, random).translation();
    const double rho = std::hypot(t.x(), t.z());
    EXPECT_GE(rho, 1.80 - 1e-9);
    EXPECT_LE(rho, 2.00 + 1e-9);
    EXPECT_GE(t.y(), 0.10 - 1e-9);
    EXPECT_LE(t.y(), 0.40 + 1e-9);
    const double phi = std::fmod(std::atan2(t.z(), t.x()) / kDegree + 360, 360);
    const double off = phi - (90 * std::floor(phi / 90) + 45);
    ASSERT_LE(std::abs(off), 10 + 1e-9);
    ++placements[static_cast<std::size_t>(phi / 90)];
    ++quarters[std::min<std::size_t>(static_cast<std::size_t>((off + 10) / 5), 3)];
  }
  const double quarter = kCount / 4.0;
  for (const int count : placements) EXPECT_NEAR(count, quarter, 5 * std::sqrt(quarter));
  for (const int count : quarters) EXPECT_NEAR(count, quarter, 5 * std::sqrt(quarter));
}

TEST(PoseSamplerTest, NeedsAMountingRoll) {
  PoseConfig config;
  config.roll_offsets_deg.clear();
  RandomStream random(1, 1, "pose");
  EXPECT_THROW(SamplePose(config, random), ConfigError);
}

}  // namespace
}  // namespace volalign::pose_sampler_test

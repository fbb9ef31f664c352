#include "core/geometry/procrustes.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/error.h"
#include "core/base/random.h"
#include "tests/core/base/expect_error.h"

namespace volalign::procrustes_test {
namespace {

using Eigen::Vector3d;
using Points = std::vector<Vector3d>;

Vector3d RandomVector(RandomStream& random) {
  return {random.Normal(), random.Normal(), random.Normal()};
}

Points RandomPoints(RandomStream& random, int n, const Vector3d& spread = {1, 1, 1}) {
  Points points;
  for (int i = 0; i < n; ++i) points.push_back(RandomVector(random).cwiseProduct(spread));
  return points;
}

/// Rotation of a random unit quaternion, written out (no Eigen::Geometry on the way).
Pose RandomPose(RandomStream& random) {
  Eigen::Vector4d q{random.Normal(), random.Normal(), random.Normal(), random.Normal()};
  q.normalize();
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  Pose pose = Pose::Identity();
  pose.linear() << 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 2 * (x * z - w * y),
      2 * (y * z + w * x), 1 - 2 * (x * x + y * y);
  pose.translation() = 3 * RandomVector(random);
  return pose;
}

Points Transformed(const Pose& pose, const Points& points) {
  Points out;
  for (const auto& p : points) out.push_back(pose.linear() * p + pose.translation());
  return out;
}

double Cost(const Pose& pose, const Points& source, const Points& target,
            const std::vector<double>& weights) {
  double sum = 0;
  for (std::size_t i = 0; i < source.size(); ++i) {
    sum += weights[i] * (target[i] - pose * source[i]).squaredNorm();
  }
  return sum;
}

TEST(AlignPoints, RecoversRandomPoses) {
  RandomStream random(1, 0, "procrustes");
  for (int i = 0; i < 200; ++i) {
    const Pose truth = RandomPose(random);
    const Points source = RandomPoints(random, 3 + i % 20);
    const ProcrustesResult result = AlignPoints(source, Transformed(truth, source));
    EXPECT_LT((result.target_from_source.matrix() - truth.matrix()).norm(), 1e-12 * 10) << i;
    EXPECT_LT(result.rms, 1e-12 * 10);
  }
}

TEST(AlignPoints, PlanarPointsFixTheRotation) {
  RandomStream random(1, 1, "procrustes");
  for (int i = 0; i < 100; ++i) {
    const Pose truth = RandomPose(random);
    const Points source = RandomPoints(random, 3 + i % 5, {1, 0.7, 0});
    const ProcrustesResult result = AlignPoints(source, Transformed(truth, source));
    EXPECT_LT((result.target_from_source.matrix() - truth.matrix()).norm(), 1e-10) << i;
    EXPECT_NEAR(result.target_from_source.linear().determinant(), 1, 1e-12);
    EXPECT_NEAR(result.extents[2], 0, 1e-7);
  }
}

TEST(AlignPoints, CollinearPointsStillGiveAProperRotation) {
  RandomStream random(1, 2, "procrustes");
  for (int i = 0; i < 50; ++i) {
    const Pose truth = RandomPose(random);
    const Points source = RandomPoints(random, 4, {1, 0, 0});
    const ProcrustesResult result = AlignPoints(source, Transformed(truth, source));
    EXPECT_NEAR(result.target_from_source.linear().determinant(), 1, 1e-12);
    EXPECT_LT(result.rms, 1e-12);
    EXPECT_LT(SecondSingularValue(source), 1e-12);
  }
  const ProcrustesResult one = AlignPoints({{1, 2, 3}}, {{0, 0, 5}});
  EXPECT_NEAR(one.target_from_source.linear().determinant(), 1, 1e-12);
  EXPECT_LT((one.target_from_source * Vector3d(1, 2, 3) - Vector3d(0, 0, 5)).norm(), 1e-12);
}

// The best orthogonal matrix is a mirror here. Its closed-form proper replacement for points on the
// axes flips the direction of the smallest extent: with x -> -x, y and z the larger ones, the
// identity remains.
TEST(AlignPoints, AMirrorImageGivesAProperRotation) {
  const Points source = {{0.1, 0, 0}, {-0.1, 0, 0}, {0, 2, 0}, {0, -2, 0}, {0, 0, 3}, {0, 0, -3}};
  Points target = source;
  for (auto& p : target) p.x() = -p.x();
  const ProcrustesResult result = AlignPoints(source, target);
  EXPECT_LT((result.target_from_source.matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-12);
  EXPECT_NEAR(result.rms, std::sqrt(2 * 0.04 / 6), 1e-12);

  RandomStream random(1, 3, "procrustes");
  for (int i = 0; i < 50; ++i) {
    const Pose pose = RandomPose(random);
    const Points points = RandomPoints(random, 6);
    Points mirrored = points;
    for (auto& p : mirrored) p.y() = -p.y();
    const auto aligned = AlignPoints(points, Transformed(pose, mirrored)).target_from_source;
    EXPECT_NEAR(aligned.linear().determinant(), 1, 1e-12);
  }
}

// The definition itself: no rigid transform nearby has a lower cost.
TEST(AlignPoints, IsAMinimumOfTheWeightedCost) {
  RandomStream random(1, 4, "procrustes");
  for (int i = 0; i < 30; ++i) {
    const Points source = RandomPoints(random, 6);
    Points target = Transformed(RandomPose(random), source);
    std::vector<double> weights;
    for (auto& p : target) {
      p += 0.2 * RandomVector(random);
      weights.push_back(random.Uniform(0.1, 3));
    }
    const ProcrustesResult result = AlignPoints(source, target, weights);
    const double best = Cost(result.target_from_source, source, target, weights);
    double total = 0;
    for (const double w : weights) total += w;
    EXPECT_NEAR(result.rms, std::sqrt(best / total), 1e-12);
    for (int k = 0; k < 40; ++k) {
      Vector6d delta;
      delta << RandomVector(random), RandomVector(random);
      const Pose other = PerturbLeft(std::pow(10, -k % 5) * delta, result.target_from_source);
      EXPECT_GE(Cost(other, source, target, weights), best - 1e-12);
    }
  }
}

TEST(AlignPoints, AWeightIsARepetition) {
  RandomStream random(1, 5, "procrustes");
  const Points source = RandomPoints(random, 5);
  Points target = Transformed(RandomPose(random), source);
  for (auto& p : target) p += 0.1 * RandomVector(random);
  const std::vector<double> weights = {1, 3, 2, 0, 4};
  Points many_source, many_target;
  for (std::size_t i = 0; i < source.size(); ++i) {
    for (int k = 0; k < static_cast<int>(weights[i]); ++k) {
      many_source.push_back(source[i]);
      many_target.push_back(target[i]);
    }
  }
  const ProcrustesResult weighted = AlignPoints(source, target, weights);
  const ProcrustesResult repeated = AlignPoints(many_source, many_target);
  EXPECT_LT((weighted.target_from_source.matrix() - repeated.target_from_source.matrix()).norm(),
            1e-12);
  EXPECT_NEAR(weighted.rms, repeated.rms, 1e-12);
  EXPECT_LT((weighted.extents - repeated.extents).norm(), 1e-12);
}

// Four corners of a rectangle a x b: squared singular values a^2 and b^2.
TEST(AlignPoints, ExtentsOfARectangle) {
  RandomStream random(1, 6, "procrustes");
  const Points source = {{0.4, 0.1, 0}, {-0.4, 0.1, 0}, {-0.4, -0.1, 0}, {0.4, -0.1, 0}};
  const auto result = AlignPoints(source, Transformed(RandomPose(random), source));
  EXPECT_NEAR(result.extents[0], 0.4, 1e-9);
  EXPECT_NEAR(result.extents[1], 0.1, 1e-9);
  EXPECT_NEAR(result.extents[2], 0, 1e-7);
  EXPECT_NEAR(SecondSingularValue(source), 0.2, 1e-12);
}

TEST(SecondSingularValue, ClosedForms) {
  EXPECT_EQ(SecondSingularValue({}), 0);
  EXPECT_EQ(SecondSingularValue({{1, 2, 3}}), 0);
  EXPECT_NEAR(SecondSingularValue({{1, 2, 3}, {4, 0, 1}}), 0, 1e-15);
  EXPECT_NEAR(SecondSingularValue({{0, 0, 0}, {1, 2, 3}, {2, 4, 6}, {-3, -6, -9}}), 0, 1e-14);
  // Ends of three axes: squared singular values 2a^2, 2b^2, 2c^2.
  EXPECT_NEAR(SecondSingularValue(
                  {{1, 0, 0}, {-1, 0, 0}, {0, .3, 0}, {0, -.3, 0}, {0, 0, .1}, {0, 0, -.1}}),
              0.3 * std::sqrt(2), 1e-14);
  // An equilateral triangle of side s: both are s / sqrt(2).
  EXPECT_NEAR(SecondSingularValue({{0, 0, 7}, {1, 0, 7}, {0.5, std::sqrt(0.75), 7}}),
              std::sqrt(0.5), 1e-14);
}

TEST(SecondSingularValue, DoesNotDependOnTheFrame) {
  RandomStream random(1, 7, "procrustes");
  const Points points = RandomPoints(random, 9);
  const double value = SecondSingularValue(points);
  for (int i = 0; i < 10; ++i) {
    EXPECT_NEAR(SecondSingularValue(Transformed(RandomPose(random), points)), value, 1e-12);
  }
}

TEST(AlignPoints, RejectsBadInput) {
  const Points two = {{0, 0, 0}, {1, 0, 0}}, three = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  ExpectError<Error>([&] { AlignPoints({}, {}); }, {"0 source points"});
  ExpectError<Error>([&] { AlignPoints(two, three); }, {"2 source points", "3 target points"});
  ExpectError<Error>([&] { AlignPoints(two, two, {1}); }, {"1 weights"});
  ExpectError<Error>([&] { AlignPoints(two, two, {0, 0}); }, {"weights"});
  ExpectError<Error>(
      [&] {
        AlignPoints(two, two, {1, std::numeric_limits<double>::quiet_NaN()});
      },
      {"weights"});
}

}  // namespace
}  // namespace volalign::procrustes_test

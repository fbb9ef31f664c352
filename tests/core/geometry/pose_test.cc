#include "core/geometry/pose.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

#include "core/base/image.h"
#include "core/base/random.h"
#include "core/geometry/factor.h"
#include "core/geometry/metrics.h"
#include "core/geometry/procrustes.h"
#include "tests/core/base/expect_error.h"

namespace volalign::pose_test {
namespace {

constexpr double kPi = 3.14159265358979323846;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using refine_internal::Factor;
using refine_internal::LogRoot;

Vector3d RandomVector(RandomStream& random, double scale = 1) {
  return scale * Vector3d{random.Normal(), random.Normal(), random.Normal()};
}

/// The matrix exponential, which knows nothing of rotations.
Matrix3d SeriesExp(const Vector3d& w) { return Cross(w).exp(); }

TEST(RotationExp, IsTheMatrixExponential) {
  RandomStream random(1, 0, "exp");
  for (const double scale : {1e-14, 1e-12, 1e-9, 1e-5, 1e-2, 0.5, 1.5}) {
    for (int i = 0; i < 20; ++i) {
      const Vector3d w = RandomVector(random, scale);
      EXPECT_LT((RotationExp(w) - SeriesExp(w)).norm(), 1e-13) << w.transpose();
    }
  }
  EXPECT_EQ(RotationExp(Vector3d::Zero()), Matrix3d(Matrix3d::Identity()));
}

TEST(RotationLog, InvertsExp) {
  RandomStream random(1, 1, "log");
  EXPECT_LT(RotationLog(Matrix3d::Identity()).norm(), 1e-15);
  for (const double angle : {1e-9, 1e-6, 1e-3, 0.1, 1.0, 2.0, 3.0, kPi - 1e-3, kPi - 1e-6}) {
    for (int i = 0; i < 20; ++i) {
      const Vector3d w = angle * RandomVector(random).normalized();
      EXPECT_LT((RotationLog(RotationExp(w)) - w).norm(), 1e-9) << angle;
    }
  }
}

TEST(RotationLog, HalfTurnsAndBeyondGiveTheShorterWay) {
  RandomStream random(1, 2, "half");
  for (int i = 0; i < 20; ++i) {
    const Vector3d axis = RandomVector(random).normalized();
    const Vector3d half = RotationLog(RotationExp(kPi * axis));
    EXPECT_NEAR(half.norm(), kPi, 1e-9);
    EXPECT_NEAR(std::abs(half.dot(axis)), kPi, 1e-9);
    EXPECT_LT((RotationLog(RotationExp(4 * axis)) - (4 - 2 * kPi) * axis).norm(), 1e-9);
  }
}

TEST(PerturbLeft, IsTheFormulaOfTheDesign) {
  RandomStream random(1, 3, "perturb");
  for (int i = 0; i < 10; ++i) {
    Pose pose = Pose::Identity();
    pose.linear() = SeriesExp(RandomVector(random));
    pose.translation() = RandomVector(random);
    Vector6d delta;
    delta << RandomVector(random, 0.1), RandomVector(random, 0.1);
    const Vector3d p = RandomVector(random);
    const Vector3d expected = SeriesExp(delta.tail<3>()) * (pose * p) + delta.head<3>();
    EXPECT_LT((PerturbLeft(delta, pose) * p - expected).norm(), 1e-12);
  }
}

TEST(ComparePoses, GivesDistanceAndAngle) {
  Pose a = Pose::Identity();
  a.linear() = SeriesExp({0.3, -0.2, 1});
  a.translation() = Vector3d(1, 2, 3);
  Pose b = a;
  b.translation() += Vector3d(0.03, 0, 0.04);
  b.linear() = a.linear() * SeriesExp(Vector3d(1, 2, 2) / 3 * (5 * kPi / 180));
  const PoseError error = ComparePoses(a, b);
  EXPECT_NEAR(error.translation_m, 0.05, 1e-12);
  EXPECT_NEAR(error.rotation_deg, 5, 1e-9);
  EXPECT_NEAR(ComparePoses(a, a).rotation_deg, 0, 1e-6);
}

TEST(LookAt, IsLevelAndLooksAtTheTarget) {
  RandomStream random(1, 4, "lookat");
  for (int i = 0; i < 100; ++i) {
    const Vector3d position = RandomVector(random, 2), target = RandomVector(random, 0.2);
    const Pose pose = LookAt(position, target, 0);
    EXPECT_LT((pose.linear().transpose() * pose.linear() - Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_NEAR(pose.linear().determinant(), 1, 1e-12);
    EXPECT_LT((pose.translation() - position).norm(), 1e-15);
    const Vector3d seen = pose.inverse() * target;
    EXPECT_NEAR(seen.x(), 0, 1e-12);
    EXPECT_NEAR(seen.y(), 0, 1e-12);
    EXPECT_NEAR(seen.z(), (target - position).norm(), 1e-12);
    EXPECT_NEAR(pose.linear()(1, 0), 0, 1e-12);  // x axis parallel to the floor
    EXPECT_LT(pose.linear()(1, 1), 0);           // y axis points down
    // Whatever lies above the target is seen higher in the image.
    EXPECT_LT((pose.inverse() * Vector3d(target + Vector3d(0, 0.1, 0))).y(), 0);
  }
}

TEST(LookAt, RollTurnsAboutTheViewingDirection) {
  RandomStream random(1, 5, "roll");
  for (int i = 0; i < 20; ++i) {
    const Vector3d position = RandomVector(random, 2);
    const double roll = i == 0 ? kPi / 2 : random.Uniform(-3, 3);
    const Pose level = LookAt(position, {0, 0.1, 0}, 0),
               rolled = LookAt(position, {0, 0.1, 0}, roll);
    EXPECT_LT((level.linear() * SeriesExp({0, 0, roll}) - rolled.linear()).norm(), 1e-12);
  }
}

TEST(LookAt, RejectsVerticalAndMissingDirections) {
  ExpectError<Error>([] { LookAt({1, 2, 3}, {1, 0, 3}, 0); }, {"(1, 2, 3)", "(1, 0, 3)"});
  ExpectError<Error>([] { LookAt({1, 2, 3}, {1, 2, 3}, 0); });
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ExpectError<Error>([&] { LookAt({1, nan, 3}, {1, 0, 3}, 0); });
  ExpectError<Error>([&] { LookAt({1, 0, 3}, {1, 0, 2}, nan); });
}

// Of the four clockwise turns, each a turn of the sensor by -90 deg about its axis, the one after
// which the picture's +y points most nearly to the floor.
TEST(UprightTurns, BringsTheFloorToTheBottom) {
  RandomStream random(1, 6, "upright");
  for (int i = 0; i < 200; ++i) {
    const Vector3d position = RandomVector(random, 2);
    const double roll = i < 4 ? i * kPi / 2 : random.Uniform(-4, 4);
    const Pose pose = LookAt(position, {0, 0, 0}, roll);
    int best = -1;
    double lowest = 1;
    for (int turns = 0; turns < 4; ++turns) {
      const double height = (pose.linear() * SeriesExp({0, 0, -turns * kPi / 2}))(1, 1);
      if (height < lowest) {
        lowest = height;
        best = turns;
      }
    }
    EXPECT_EQ(UprightTurns(pose), best) << roll;
    if (i >= 4) continue;
    EXPECT_EQ(best, i);  // a roll of +90 deg is undone by one clockwise turn
  }
}

TEST(Turn, FollowsItsFormulaAndComposes) {
  LabelImage image(3, 2);
  for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<std::uint8_t>(i + 1);
  // 1 2 3      4 1
  // 4 5 6  ->  5 2
  //            6 3
  const LabelImage once = Turn(image, 1);
  ASSERT_EQ(once.width(), 2);
  ASSERT_EQ(once.height(), 3);
  EXPECT_EQ(std::vector<int>(once.begin(), once.end()), (std::vector<int>{4, 1, 5, 2, 6, 3}));
  EXPECT_EQ(Turn(once, 1), Turn(image, 2));
  EXPECT_EQ(Turn(once, 2), Turn(image, 3));
  EXPECT_EQ(Turn(once, -1), image);
  EXPECT_EQ(Turn(image, -1), Turn(image, 3));
  EXPECT_EQ(Turn(image, 8), image);
}

TEST(PoseRows, RoundTrip) {
  const Pose pose = LookAt({1, 0.4, -2}, {0.1, 0, 0}, 0.2);
  const auto rows = ToRows(pose);
  EXPECT_EQ(rows[0][3], 1);  // row-major: the position is the last column
  EXPECT_EQ(rows[1][3], 0.4);
  EXPECT_EQ(rows[2][3], -2);
  EXPECT_EQ(rows[3], (std::vector<double>{0, 0, 0, 1}));
  EXPECT_EQ(PoseFromMatrix(pose.matrix(), "x").matrix(), pose.matrix());
}

TEST(PoseRows, RejectsWhatIsNoRigidTransform) {
  const Eigen::Matrix4d good = LookAt({1, 0.4, -2}, {0.1, 0, 0}, 0.2).matrix();
  const auto expect_bad = [&](const auto& spoil) {
    Eigen::Matrix4d matrix = good;
    spoil(matrix);
    ExpectError<DataError>([&] { PoseFromMatrix(matrix, "ground_truth of KA03"); },
                           {"ground_truth of KA03"});
  };
  expect_bad([](auto& m) { m(0, 1) = std::numeric_limits<double>::quiet_NaN(); });
  expect_bad([](auto& m) { m(1, 3) = std::numeric_limits<double>::infinity(); });
  expect_bad([](auto& m) { m.row(0).template head<3>() *= -1; });  // a mirror
  expect_bad([](auto& m) { m.row(0).template head<3>() *= 1.01; });
  expect_bad([](auto& m) { m.transposeInPlace(); });  // the translation is in the last row
}

using Points = std::vector<Vector3d>;

Points RandomPoints(RandomStream& random, int n, const Vector3d& spread = {1, 1, 1}) {
  Points points;
  for (int i = 0; i < n; ++i) points.push_back(RandomVector(random).cwiseProduct(spread));
  return points;
}

Pose RandomPose(RandomStream& random) {
  Pose pose = Pose::Identity();
  pose.linear() = SeriesExp(RandomVector(random));
  pose.translation() = 3 * RandomVector(random);
  return pose;
}

Points Transformed(const Pose& pose, const Points& points) {
  Points out;
  for (const auto& p : points) out.push_back(pose.linear() * p + pose.translation());
  return out;
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

// Of noisy points, some of which are mirrored, and of exact ones, some of them in a plane.
TEST(AlignPoints, IsUmeyamasWithoutScale) {
  RandomStream random(1, 4, "procrustes");
  constexpr int kPoints = 6;
  for (int i = 0; i < 120; ++i) {
    const bool exact = i >= 60, planar = i >= 90;
    const Points source = RandomPoints(random, kPoints, {1, 0.7, planar ? 0.0 : 1.0});
    Points target = source;
    for (auto& p : target) p.y() = exact || i % 2 == 0 ? p.y() : -p.y();
    target = Transformed(RandomPose(random), target);
    for (auto& p : target) p += (exact ? 0 : 0.2) * RandomVector(random);
    const Eigen::Map<const Eigen::Matrix3Xd> from(source[0].data(), 3, kPoints),
        to(target[0].data(), 3, kPoints);
    const Pose expected(Eigen::umeyama(from, to, /*with_scaling=*/false));
    const ProcrustesResult result = AlignPoints(source, target);
    EXPECT_LT((result.target_from_source.matrix() - expected.matrix()).norm(), 1e-10);
    EXPECT_LT(planar ? result.extents[2] : 0, 1e-7);
    EXPECT_NEAR(result.rms, (expected * from - to).norm() / std::sqrt(kPoints), 1e-12);
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

TEST(AlignPoints, RejectsBadInput) {
  const Points two = {{0, 0, 0}, {1, 0, 0}}, three = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  ExpectError<Error>([&] { AlignPoints({}, {}); }, {"0 source points"});
  ExpectError<Error>([&] { AlignPoints(two, three); }, {"2 source points", "3 target points"});
  ExpectError<Error>([&] { AlignPoints(two, two, {1}); }, {"1 weights"});
  ExpectError<Error>([&] { AlignPoints(two, two, {0, 0}); }, {"weights"});
  const std::vector<double> bad = {1, std::numeric_limits<double>::quiet_NaN()};
  ExpectError<Error>([&] { AlignPoints(two, two, bad); }, {"weights"});
}

LabelImage RandomLabels(RandomStream& random, int width, int height, int classes) {
  LabelImage image(width, height);
  for (auto& x : image) x = static_cast<std::uint8_t>(random.Below(classes));
  return image;
}

/// Pixels of each class in both and in either, as the definition says.
double BruteForceIou(const LabelImage& a, const LabelImage& b, const DepthImage& depth, int classes,
                     bool absent_counts) {
  double sum = 0, count = 0;
  for (int k = 0; k < classes; ++k) {
    double both = 0, either = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      if (!depth.empty() && !(depth[i] > 0)) continue;
      both += a[i] == k && b[i] == k;
      either += a[i] == k || b[i] == k;
    }
    if (either == 0 && !absent_counts) continue;
    sum += either == 0 ? 1 : both / either;
    ++count;
  }
  return count == 0 ? 1 : sum / count;
}

TEST(MeanIou, AgreesWithBruteForce) {
  RandomStream random(1, 0, "iou");
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  for (int i = 0; i < 60; ++i) {
    const int classes = 21;
    // Few classes in use, so that most are absent.
    const LabelImage a = RandomLabels(random, 13, 9, 1 + i % 6);
    LabelImage b = a;
    for (auto& x : b) {
      if (random.Chance(0.3)) x = static_cast<std::uint8_t>(random.Below(1 + i % 9));
    }
    DepthImage depth;
    if (i % 2) {
      depth = DepthImage(13, 9);
      // In the first one, no pixel counts.
      for (auto& z : depth)
        z = i > 1 && random.Chance(0.6) ? 2.0f : random.Chance(0.5) ? 0.0f : nan;
    }
    for (const bool absent : {false, true}) {
      EXPECT_NEAR(MeanIou(a, b, depth, {classes, absent}),
                  BruteForceIou(a, b, depth, classes, absent), 1e-12);
      EXPECT_NEAR(MeanIou(a, b, depth, {classes, absent}), MeanIou(b, a, depth, {classes, absent}),
                  1e-12);
    }
  }
}

TEST(MeanIou, RejectsBadInput) {
  const LabelImage a(4, 3), b(3, 4);
  ExpectError<Error>([&] { MeanIou(a, b, {}, {21, false}); }, {"sizes"});
  ExpectError<Error>([&] { MeanIou(a, a, DepthImage(3, 4), {21, false}); }, {"sizes"});
  ExpectError<Error>([&] { MeanIou(LabelImage(4, 3, 21), a, {}, {21, false}); }, {"21"});
  ExpectError<Error>([&] { MeanIou(a, LabelImage(4, 3, 30), {}, {21, false}); }, {"30"});
}

double BruteForceDistance(const Points& a, const Points& b) {
  double sum = 0;
  for (const auto& p : a) {
    double best = std::numeric_limits<double>::infinity();
    for (const auto& q : b) best = std::min(best, (p - q).squaredNorm());
    sum += best;
  }
  return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(RmsDistance, AgreesWithBruteForce) {
  RandomStream random(1, 1, "rms");
  for (const auto& [n, m] : {std::pair(1, 1), {1, 50}, {50, 1}, {300, 17}, {400, 1500}}) {
    const Points a = RandomPoints(random, n), b = RandomPoints(random, m);
    EXPECT_NEAR(RmsDistance(a, b), BruteForceDistance(a, b), 1e-12);
    const SetDistances d = CompareSets(a, b);
    EXPECT_NEAR(d.d1, BruteForceDistance(a, b), 1e-12);
    EXPECT_NEAR(d.d2, std::max(BruteForceDistance(a, b), BruteForceDistance(b, a)), 1e-12);
  }
}

TEST(RmsDistance, IsTheSameOnAnyNumberOfThreads) {
  RandomStream random(1, 3, "rms");
  const Points a = RandomPoints(random, 9000), b = RandomPoints(random, 20);
  EXPECT_NEAR(RmsDistance(a, b, 3), BruteForceDistance(a, b), 1e-12);
  EXPECT_EQ(RmsDistance(a, b, 3), RmsDistance(a, b, 1));
}

TEST(RmsDistance, RepeatedPoints) {
  EXPECT_NEAR(RmsDistance({{1, 2, 5}}, Points(100, Eigen::Vector3d(1, 2, 3))), 2, 1e-15);
}

TEST(RmsDistance, RejectsEmptySets) {
  ExpectError<Error>([] { RmsDistance({}, {{0, 0, 0}}); }, {"empty"});
  ExpectError<Error>([] { RmsDistance({{0, 0, 0}}, {}); }, {"empty"});
}

// 1 ... n: mean (n + 1) / 2, population variance (n^2 - 1) / 12.
TEST(Summarise, ClosedForms) {
  const int n = 101;
  std::vector<double> values;
  for (int i = n; i >= 1; --i) values.push_back(i);
  const Summary summary = Summarise(values);
  EXPECT_NEAR(summary.mean, 51, 1e-12);
  EXPECT_NEAR(summary.std, std::sqrt((n * n - 1) / 12.0), 1e-12);
  EXPECT_NEAR(summary.rsd, summary.std / 51, 1e-12);
  EXPECT_NEAR(summary.median, 51, 1e-12);
  EXPECT_NEAR(summary.p95, 96, 1e-12);

  struct Case {
    std::vector<double> values;
    double mean, std, highest;
  };
  for (const Case& c : {Case{{3, 1}, 2, 1, 3}, Case{{4}, 4, 0, 4}, Case{{}, 0, 0, 0}}) {
    const Summary few = Summarise(c.values);
    EXPECT_NEAR(few.mean, c.mean, 1e-15);
    EXPECT_NEAR(few.std, c.std, 1e-15);
    EXPECT_EQ(few.median, c.highest);
    EXPECT_EQ(few.p95, c.highest);
  }
  EXPECT_EQ(Summarise({-1, 1}).rsd, 0);  // no relative deviation from a mean of 0
}

TEST(Factor, SolvesWhereThereIsOne) {
  Eigen::Matrix3d matrix;
  matrix << 4, 1, 0, 1, 3, -1, 0, -1, 2;
  const auto factor = Factor(matrix);
  ASSERT_TRUE(factor.has_value());
  const Eigen::Vector3d b(1, 2, 3);
  EXPECT_LT((matrix * factor->solve(b) - b).norm(), 1e-12);
  EXPECT_NEAR(LogRoot(*factor), 0.5 * std::log(matrix.determinant()), 1e-12);
}

TEST(Factor, IsNothingElsewhere) {
  Eigen::Matrix2d indefinite;
  indefinite << 1, 2, 2, 1;
  EXPECT_FALSE(Factor(indefinite));
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 0.0, -1.0}) {
    Eigen::Matrix2d matrix = Eigen::Matrix2d::Identity();
    matrix(1, 1) = bad;
    EXPECT_FALSE(Factor(matrix)) << bad;
  }
}

}  // namespace
}  // namespace volalign::pose_test

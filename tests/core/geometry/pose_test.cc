#include "core/geometry/pose.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "core/base/error.h"
#include "core/base/image.h"
#include "core/base/random.h"
#include "core/geometry/camera.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/geometry/quarter_turn_pose.h"

namespace volalign::pose_test {
namespace {

constexpr double kPi = 3.14159265358979323846;
using Eigen::Matrix3d;
using Eigen::Vector3d;

Vector3d RandomVector(RandomStream& random, double scale = 1) {
  return scale * Vector3d{random.Normal(), random.Normal(), random.Normal()};
}

Matrix3d Skew(const Vector3d& w) {
  Matrix3d m;
  m << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  return m;
}

/// The matrix exponential by its power series.
Matrix3d SeriesExp(const Vector3d& w) {
  Matrix3d sum = Matrix3d::Identity(), term = Matrix3d::Identity();
  for (int k = 1; k < 60; ++k) {
    term = term * Skew(w) / k;
    sum += term;
  }
  return sum;
}

TEST(RotationExp, AgreesWithThePowerSeries) {
  RandomStream random(1, 0, "exp");
  for (const double scale : {1e-14, 1e-12, 1e-9, 1e-5, 1e-2, 0.5, 1.5}) {
    for (int i = 0; i < 20; ++i) {
      const Vector3d w = RandomVector(random, scale);
      EXPECT_LT((RotationExp(w) - SeriesExp(w)).norm(), 1e-13) << w.transpose();
    }
  }
  EXPECT_EQ(RotationExp(Vector3d::Zero()), Matrix3d(Matrix3d::Identity()));
}

TEST(RotationExp, TurnsByTheRightHandRule) {
  Matrix3d quarter;
  quarter << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  EXPECT_LT((RotationExp({0, 0, kPi / 2}) - quarter).norm(), 1e-15);
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

TEST(LookAt, ClosedFormFromTheFront) {
  // From +x to the origin: forward -x, down -y, and so right = down x forward = -z.
  Matrix3d expected;
  expected << 0, 0, -1, 0, -1, 0, -1, 0, 0;
  EXPECT_LT((LookAt({2, 0, 0}, {0, 0, 0}, 0).linear() - expected).norm(), 1e-15);
}

TEST(LookAt, RollOf90DegreesTurnsImageXToTheFloor) {
  RandomStream random(1, 5, "roll");
  for (int i = 0; i < 20; ++i) {
    Vector3d position = RandomVector(random, 2);
    position.y() = 0.1;
    const Pose level = LookAt(position, {0, 0.1, 0}, 0);
    const Pose turned = LookAt(position, {0, 0.1, 0}, kPi / 2);
    EXPECT_LT((turned.linear().col(0) - Vector3d(0, -1, 0)).norm(), 1e-12);
    EXPECT_LT((turned.linear().col(1) + level.linear().col(0)).norm(), 1e-12);
    EXPECT_LT((turned.linear().col(2) - level.linear().col(2)).norm(), 1e-12);
  }
  // Any roll: the angle between the x axes, signed about the viewing direction.
  const Pose level = LookAt({1, 0.5, 2}, {0, 0, 0}, 0),
             rolled = LookAt({1, 0.5, 2}, {0, 0, 0}, 0.3);
  const Vector3d x = level.linear().transpose() * rolled.linear().col(0);
  EXPECT_NEAR(std::atan2(x.y(), x.x()), 0.3, 1e-12);
}

TEST(LookAt, RejectsVerticalAndMissingDirections) {
  ExpectError<Error>([] { LookAt({1, 2, 3}, {1, 0, 3}, 0); }, {"(1, 2, 3)", "(1, 0, 3)"});
  ExpectError<Error>([] { LookAt({1, 2, 3}, {1, 2, 3}, 0); });
  const double nan = std::numeric_limits<double>::quiet_NaN();
  ExpectError<Error>([&] { LookAt({1, nan, 3}, {1, 0, 3}, 0); });
  ExpectError<Error>([&] { LookAt({1, 0, 3}, {1, 0, 2}, nan); });
}

// One clockwise turn sends the pixel (u, v) to (height - 1 - v, u), so the pixel that shows a point
// can be followed through Turn(), and projecting that point through the turned sensor has to end in
// the same pixel.
TEST(QuarterTurnPose, AgreesWithTurnedImageAndIntrinsics) {
  Intrinsics intrinsics;
  intrinsics.width = 40;
  intrinsics.height = 30;
  intrinsics.fx = 31;
  intrinsics.fy = 33;
  intrinsics.cx = 18.3;
  intrinsics.cy = 15.9;
  for (int turns = -5; turns <= 6; ++turns) {
    const Intrinsics turned = intrinsics.Turned(turns);
    const Pose sensor_from_turned = QuarterTurnPose(turns);
    for (const auto& [u, v] : {std::pair(0, 0), {39, 0}, {0, 29}, {39, 29}, {7, 21}}) {
      LabelImage image(40, 30);
      image(u, v) = 1;
      const LabelImage seen = Turn(image, turns);
      ASSERT_EQ(seen.width(), turned.width);
      ASSERT_EQ(seen.height(), turned.height);
      const double z = 1.7;
      const Vector3d p_sensor(z * (u - intrinsics.cx) / intrinsics.fx,
                              z * (v - intrinsics.cy) / intrinsics.fy, z);
      const Vector3d p = sensor_from_turned.inverse() * p_sensor;
      const double pu = turned.fx * p.x() / p.z() + turned.cx;
      const double pv = turned.fy * p.y() / p.z() + turned.cy;
      EXPECT_NEAR(pu, std::round(pu), 1e-9);
      EXPECT_NEAR(pv, std::round(pv), 1e-9);
      const int iu = static_cast<int>(std::lround(pu)), iv = static_cast<int>(std::lround(pv));
      ASSERT_TRUE(seen.Contains(iu, iv)) << turns;
      EXPECT_EQ(seen(iu, iv), 1) << turns;
    }
  }
}

// A portrait sensor (roll +90) whose image is turned once clockwise... shows the floor at the
// bottom again after the turn that undoes the roll.
TEST(QuarterTurnPose, OneTurnOfARolledSensorIsLevelAgain) {
  const Pose rolled = LookAt({2, 0.3, 1}, {0, 0, 0}, kPi / 2);
  const Pose level = LookAt({2, 0.3, 1}, {0, 0, 0}, 0);
  const Pose turned = rolled * QuarterTurnPose(1);
  EXPECT_LT((turned.matrix() - level.matrix()).norm(), 1e-12);
}

// Of the four turns, the one after which the picture's +y points most nearly to the floor.
TEST(UprightTurns, BringsTheFloorToTheBottom) {
  RandomStream random(1, 6, "upright");
  for (int i = 0; i < 200; ++i) {
    const Vector3d position = RandomVector(random, 2);
    const double roll = i < 4 ? i * kPi / 2 : random.Uniform(-4, 4);
    const Pose pose = LookAt(position, {0, 0, 0}, roll);
    int best = -1;
    double lowest = 1;
    for (int turns = 0; turns < 4; ++turns) {
      const double height = (pose * QuarterTurnPose(turns)).linear()(1, 1);
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
  EXPECT_EQ(PoseFromRows(rows, "x").matrix(), pose.matrix());
}

TEST(PoseRows, RejectsWhatIsNoRigidTransform) {
  const auto good = ToRows(LookAt({1, 0.4, -2}, {0.1, 0, 0}, 0.2));
  const auto expect_bad = [](std::vector<std::vector<double>> rows) {
    ExpectError<DataError>([&] { PoseFromRows(rows, "ground_truth of KA03"); },
                           {"ground_truth of KA03"});
  };
  expect_bad({});
  auto bad = good;
  bad.pop_back();
  expect_bad(bad);
  bad = good;
  bad[2].pop_back();
  expect_bad(bad);
  bad = good;
  bad[0][1] = std::numeric_limits<double>::quiet_NaN();
  expect_bad(bad);
  bad = good;
  bad[1][3] = std::numeric_limits<double>::infinity();
  expect_bad(bad);
  bad = good;
  for (int c = 0; c < 3; ++c) bad[0][static_cast<std::size_t>(c)] *= -1;  // a mirror
  expect_bad(bad);
  bad = good;
  for (int c = 0; c < 3; ++c) bad[0][static_cast<std::size_t>(c)] *= 1.01;
  expect_bad(bad);
  bad = good;
  for (std::size_t i = 0; i < 4; ++i) {  // transposed: the translation lands in the last row
    for (std::size_t j = 0; j < i; ++j) std::swap(bad[i][j], bad[j][i]);
  }
  expect_bad(bad);
}

}  // namespace
}  // namespace volalign::pose_test

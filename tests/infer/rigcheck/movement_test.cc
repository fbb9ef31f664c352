#include "infer/rigcheck/movement.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/random.h"

namespace volalign::movement_test {
namespace {

Vector6d Normal(RandomStream* random) {
  Vector6d draw;
  for (int i = 0; i < 6; ++i) draw[i] = random->Normal();
  return draw;
}

/// Standard deviations of about 3 mm and 0.1 deg, correlated.
Matrix6d DrawCovariance(RandomStream* random) {
  Matrix6d root;
  for (int i = 0; i < 6; ++i) root.col(i) = Normal(random);
  Vector6d scale;
  scale << Eigen::Vector3d::Constant(0.001), Eigen::Vector3d::Constant(0.0006);
  const Matrix6d spread = scale.asDiagonal() * root;
  Matrix6d covariance = spread * spread.transpose();
  covariance.diagonal() += 0.1 * scale.cwiseAbs2();
  return covariance;
}

Pose Turned(const Eigen::Vector3d& rotation, const Eigen::Vector3d& translation) {
  Pose pose = Pose::Identity();
  pose.linear() = RotationExp(rotation);
  pose.translation() = translation;
  return pose;
}

/// Two captures of sensors on a ring, with errors that their covariances describe; the structure
/// was moved between them.
struct Captures {
  std::vector<SensorEstimate> last, now;
  std::vector<Pose> true_last;
  Pose last_from_now = Turned({0.02, 2.9, -0.01}, {0.4, 0.01, -0.7});

  Captures(int sensors, std::uint64_t seed, bool same_errors = false) {
    RandomStream random(seed, 0, "captures");
    for (int i = 0; i < sensors; ++i) {
      const double phi = 2 * M_PI * i / sensors;
      const Eigen::Vector3d position(2 * std::cos(phi), 0.3, 2 * std::sin(phi));
      const Pose pose = LookAt(position, Eigen::Vector3d::Zero(), 0.1 * i);
      true_last.push_back(pose);
      SensorEstimate a;
      a.name = "S" + std::to_string(i);
      a.covariance = DrawCovariance(&random);
      SensorEstimate b = a;
      const Vector6d error = a.covariance.llt().matrixL() * Normal(&random);
      a.structure_from_sensor = PerturbLeft(error, pose);
      const Pose now_from_last = last_from_now.inverse();
      const Matrix6d turn = Adjoint(now_from_last);
      b.covariance =
          turn * (same_errors ? a.covariance : DrawCovariance(&random)) * turn.transpose();
      const Vector6d other =
          same_errors ? Vector6d(turn * error)
                      : Vector6d(Matrix6d(b.covariance.llt().matrixL()) * Normal(&random));
      b.structure_from_sensor = PerturbLeft(other, now_from_last * pose);
      last.push_back(a);
      now.push_back(b);
    }
  }
  /// Moves a sensor after the first capture, about its own axes.
  void Move(int sensor, const Pose& before_from_after) {
    Pose& pose = now[static_cast<std::size_t>(sensor)].structure_from_sensor;
    pose = pose * before_from_after;
  }
};

int Count(const Movements& movements, Movement movement) {
  int count = 0;
  for (const SensorMovement& sensor : movements.sensors) count += sensor.movement == movement;
  return count;
}

// A sensor that stayed is compared with the others' motion, which it has no part in.
TEST(Movement, ASensorIsNoJudgeOfItself) {
  Captures captures(4, 1, /*same_errors=*/true);
  for (std::size_t i = 0; i < 4; ++i) {
    captures.last[i].covariance = captures.now[i].covariance = 1e-5 * Matrix6d::Identity();
    captures.now[i].structure_from_sensor =
        captures.last_from_now.inverse() * captures.last[i].structure_from_sensor;
  }
  captures.now[0].structure_from_sensor.translation().y() += 0.003;
  const Movements found = FindMovements(captures.last, captures.now);
  EXPECT_EQ(found.sensors[0].movement, Movement::kStayed);
  EXPECT_NEAR(found.sensors[0].translation_m, 0.003, 1e-5);
}

TEST(Movement, FalseAlarmsAreAsRareAsTheyShouldBe) {
  for (const int sensors : {3, 8}) {
    MovementOptions options;
    options.false_alarm = 0.02;
    int moved = 0, all = 0;
    double factor = 0;
    constexpr int kTrials = 150;
    for (int trial = 0; trial < kTrials; ++trial) {
      const Captures captures(sensors, static_cast<std::uint64_t>(trial));
      const Movements movements = FindMovements(captures.last, captures.now, options);
      all += sensors;
      moved += sensors - Count(movements, Movement::kStayed);
      factor += movements.variance_factor / kTrials;
    }
    const double share = static_cast<double>(moved) / all;
    // Two tests, by the stated and by the shown variance, may both accuse.
    EXPECT_LT(share, 0.06) << sensors;
    EXPECT_GT(share, 0.02) << sensors;
    EXPECT_GT(factor, 0.7) << sensors;
  }
}

// One in 100,000, if nothing else is said, and here of 4,800: with one in 1,000 five would be
// expected.
TEST(Movement, FalseAlarmsAreRareUnlessTheyAreAskedFor) {
  int moved = 0;
  constexpr int kTrials = 600;
  for (int trial = 0; trial < kTrials; ++trial) {
    const Captures captures(8, static_cast<std::uint64_t>(10000 + trial));
    moved += 8 - Count(FindMovements(captures.last, captures.now), Movement::kStayed);
  }
  EXPECT_EQ(moved, 0);
}

TEST(Movement, FindsTheSensorThatMovedWhereverTheStructureStands) {
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    Captures captures(8, seed);
    const int mover = static_cast<int>(seed % 8);
    const Pose before_from_after =
        Turned(Eigen::Vector3d(0, 0.02, 0.01), Eigen::Vector3d(0.02, 0.02, -0.01));
    captures.Move(mover, before_from_after);
    const Movements movements = FindMovements(captures.last, captures.now);
    ASSERT_TRUE(movements.last_from_now);
    const PoseError motion = ComparePoses(*movements.last_from_now, captures.last_from_now);
    EXPECT_LT(motion.translation_m, 0.005);
    EXPECT_LT(motion.rotation_deg, 0.15);
    EXPECT_EQ(Count(movements, Movement::kStayed), 7) << seed;
    const auto index = static_cast<std::size_t>(mover);
    const SensorMovement& found = movements.sensors[index];
    EXPECT_EQ(found.movement, Movement::kMoved) << seed;
    EXPECT_NEAR(found.translation_m, 0.03, 0.015);
    EXPECT_NEAR(found.rotation_deg, std::sqrt(5) * 0.01 * 180 / M_PI, 0.5);
    // The pose to go on with, and how well it is known.
    const Vector6d error =
        LeftDifference(found.structure_from_sensor, captures.true_last[index] * before_from_after);
    EXPECT_LT(error.dot(found.covariance.ldlt().solve(error)), 30) << seed;
  }
}

TEST(Movement, WhatIsFoundIsAsStated) {
  // Alike errors in all directions: every direction is the worst one.
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal() << 9e-6, 9e-6, 9e-6, 1e-10, 1e-10, 1e-10;
  RandomStream random(1, 0, "found");
  int found = 0, trials = 0;
  double from = 0;
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<SensorEstimate> last, now;
    for (int i = 0; i < 6; ++i) {
      SensorEstimate sensor;
      sensor.name = std::to_string(i);
      sensor.covariance = covariance;
      const Pose pose = Turned({0, 1.0 * i, 0}, {0.1 * i, 0, 0});
      for (std::vector<SensorEstimate>* of : {&last, &now}) {
        sensor.structure_from_sensor =
            PerturbLeft(Matrix6d(covariance.llt().matrixL()) * Normal(&random), pose);
        of->push_back(sensor);
      }
    }
    if (trial == 0) from = FindMovements(last, now).sensors[2].found_from_m;
    now[2].structure_from_sensor.translation() +=
        from * Eigen::Vector3d{random.Normal(), random.Normal(), random.Normal()}.normalized();
    const Movements movements = FindMovements(last, now);
    found += movements.sensors[2].movement == Movement::kMoved;
    ++trials;
  }
  EXPECT_GT(from, 0.02);
  EXPECT_LT(from, 0.06);
  EXPECT_GT(found, 0.9 * trials);
  EXPECT_LT(found, 1.0 * trials);
}

TEST(Movement, ErrorsThatBothCapturesHaveInCommonDoNotHideAMovement) {
  int found = 0, found_apart = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    for (const bool same_errors : {false, true}) {
      Captures captures(8, seed, same_errors);
      captures.Move(5, Turned(Eigen::Vector3d::Zero(), {0.006, 0, 0}));
      const Movements movements = FindMovements(captures.last, captures.now);
      (same_errors ? found : found_apart) += movements.sensors[5].movement == Movement::kMoved;
    }
  }
  EXPECT_GT(found, found_apart + 5);
}

TEST(Movement, TwoOfEightAreFound) {
  Captures captures(8, 3);
  captures.Move(0, Turned({0, 0, 0}, {0.05, 0, 0}));
  captures.Move(4, Turned({0, 0.05, 0}, {0, 0, 0}));
  const Movements movements = FindMovements(captures.last, captures.now);
  for (std::size_t i = 0; i < 8; ++i) {
    EXPECT_EQ(movements.sensors[i].movement,
              i == 0 || i == 4 ? Movement::kMoved : Movement::kStayed);
  }
}

TEST(Movement, WithoutAMajorityNothingIsDecided) {
  const Pose away = Turned({0, 0.1, 0}, {0.1, 0, 0});
  Captures two(2, 1);
  EXPECT_EQ(Count(FindMovements(two.last, two.now), Movement::kStayed), 2);
  two.Move(1, away);
  EXPECT_EQ(Count(FindMovements(two.last, two.now), Movement::kUndecided), 2);
  EXPECT_FALSE(FindMovements(two.last, two.now).last_from_now);

  // A moved pair that keeps together is another rig, of the same size.
  Captures four(4, 2);
  for (const std::size_t i : {2, 3}) {
    four.now[i].structure_from_sensor =
        Turned({0, 0.3, 0}, {0.2, 0, 0.1}) * four.now[i].structure_from_sensor;
  }
  EXPECT_EQ(Count(FindMovements(four.last, four.now), Movement::kUndecided), 4);

  Captures three(3, 1);
  three.Move(1, away);
  EXPECT_EQ(FindMovements(three.last, three.now).sensors[1].movement, Movement::kMoved);

  Captures one(1, 1);
  EXPECT_EQ(Count(FindMovements(one.last, one.now), Movement::kUndecided), 1);
  EXPECT_TRUE(FindMovements(one.last, {}).sensors.empty());
}

TEST(Movement, SensorsGoByTheirNames) {
  Captures captures(5, 7);
  captures.Move(1, Turned({0, 0, 0}, {0.05, 0, 0}));
  std::reverse(captures.now.begin(), captures.now.end());
  captures.now.erase(captures.now.begin());  // S4
  const Movements movements = FindMovements(captures.last, captures.now);
  ASSERT_EQ(movements.sensors.size(), 4u);
  EXPECT_EQ(movements.sensors[1].name, "S1");
  EXPECT_EQ(movements.sensors[1].movement, Movement::kMoved);
  EXPECT_EQ(Count(movements, Movement::kStayed), 3);
}

TEST(Movement, NumbersThatAreNotFiniteAreAnError) {
  Captures captures(3, 1);
  captures.now[1].covariance(2, 2) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(FindMovements(captures.last, captures.now), DataError);
}

/// Each of `places` has the sensor of the next one.
void Exchange(const std::vector<std::size_t>& places, std::vector<SensorEstimate>* now) {
  const std::string first = (*now)[places.front()].name;
  for (std::size_t k = 0; k + 1 < places.size(); ++k)
    (*now)[places[k]].name = (*now)[places[k + 1]].name;
  (*now)[places.back()].name = first;
}

std::string Sentence(const std::vector<Exchanged>& exchanged) {
  std::string text;
  for (const Exchanged& sensor : exchanged) text += sensor.name + " at " + sensor.place_of + "; ";
  return text;
}

TEST(FindExchanged, TwoOrMoreWhereverTheStructureStands) {
  // Sensors that have each other's intrinsics come out some centimetres off.
  const Pose off = Turned({0, 0.02, 0}, {0.04, 0, 0});
  Captures two(4, 3), three(5, 4), none(6, 5);
  Exchange({1, 2}, &two.now);
  two.Move(1, off);
  Exchange({0, 2, 3}, &three.now);
  EXPECT_EQ(Sentence(FindExchanged(two.last, two.now)), "S2 at S1; S1 at S2; ");
  EXPECT_EQ(Sentence(FindExchanged(three.last, three.now)), "S2 at S0; S3 at S2; S0 at S3; ");
  none.Move(3, Turned({0, 0.3, 0}, {0.5, 0, 0}));
  EXPECT_EQ(Sentence(FindExchanged(none.last, none.now)), "");
}

}  // namespace
}  // namespace volalign::movement_test

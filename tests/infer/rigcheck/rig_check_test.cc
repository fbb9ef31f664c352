#include "infer/rigcheck/rig_check.h"

#include <gtest/gtest.h>
#include <Eigen/Cholesky>
#include <nlohmann/json.hpp>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/base/random.h"
#include "infer/rigcheck/movement.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::rig_check_test {
namespace {

using namespace testing_infer;

Pose Moved(double x_m, double yaw_rad) { return MakePose({0, yaw_rad, 0}, {x_m, 0, -0.2}); }

/// Four sensors with errors of 2 mm and 0.05 deg, of which the calibration has none, and one that
/// failed. `from`: where the structure's frame stands.
Extrinsics Rig(const Pose& from) {
  Extrinsics rig;
  rig.tool = "volalign test";
  rig.structure = {"stack", "abc", std::nullopt};
  rig.captures = {"capture.json"};
  for (int i = 0; i < 5; ++i) {
    Extrinsics::Sensor sensor;
    sensor.name = "S" + std::to_string(i);
    sensor.status = i == 4 ? SensorStatus::kFailed : SensorStatus::kOk;
    if (i < 4) {
      sensor.structure_from_sensor = from.inverse() * RingPose(80.0 * i);
      sensor.initial = *sensor.structure_from_sensor;
    } else {
      sensor.code = SensorCode::kNoDepth;
      sensor.reason = "it has no depth";
    }
    sensor.intrinsics = sensor.intrinsics_given = Kinect();
    sensor.covariance.diagonal() << 4e-6, 4e-6, 4e-6, 1e-6, 1e-6, 1e-6;
    rig.sensors.push_back(sensor);
  }
  rig.pairs = {{"S0", "S1", 0.3, 0.001}, {"S1", "S2", 0.2, 0.002}, {"S2", "S3", 0.1, 0.003}};
  for (PairResult& pair : rig.pairs) pair.covariance = 1e-6 * Matrix6d::Identity();
  rig.placements = {{"", "capture.json", Pose::Identity(), {}, {}, {"S0"}, {}}};
  rig.metrics = SetDistances{};
  return rig;
}

TEST(RigCheck, AReplacedSensorHasTheNewCapturesPoseOrNone) {
  const Extrinsics last = Rig(Pose::Identity());
  Extrinsics now = Rig(Moved(0.5, 0.7));
  MovementOptions options;
  options.moved = {"S1", "S2"};
  options.one_may_stay = true;
  now.sensors = {now.sensors[0], now.sensors[1], now.sensors[2], now.sensors[3]};
  now.sensors[0].name = "S5";
  now.sensors[2].status = SensorStatus::kFailed;
  now.sensors[2].structure_from_sensor.reset();
  now.sensors[2].covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  const RigCheck check = CheckRig("last.json", last, now, options);
  EXPECT_TRUE(Has(UpdateSentence(last, now, check), "New poses: S5, S1. ",
                  "No pose in the new capture: S2. ", "poses kept: S3"));
  EXPECT_TRUE(Has(FormatRigCheck(check), "S3 is trusted to have stayed"));
  Extrinsics old = last;
  old.alternatives = {{1, "", {{"S1", 2, Pose::Identity()}}},
                      {1, "", {{"S0", 2, Pose::Identity()}}}};
  now.alternatives = {{1, "", {{"S5", 2, Pose::Identity()}}}};
  now.sensors[0].colour.emplace();
  now.sensors[0].colour->structure_from_colour = now.sensors[0].structure_from_sensor;
  const Extrinsics updated = UpdateExtrinsics(old, now, check);
  ASSERT_EQ(updated.alternatives.size(), 2u);
  EXPECT_EQ(updated.alternatives[0].sensors[0].name, "S0");
  EXPECT_EQ(updated.alternatives[1].sensors[0].structure_from_sensor.matrix(),
            check.movements.last_from_now->matrix());
  ASSERT_EQ(updated.sensors.size(), 6u);
  EXPECT_EQ(updated.sensors[5].colour->structure_from_colour->matrix(),
            updated.sensors[5].structure_from_sensor->matrix());
  EXPECT_EQ(updated.sensors[3].structure_from_sensor->matrix(),
            last.sensors[3].structure_from_sensor->matrix());
  EXPECT_FALSE(updated.sensors[2].structure_from_sensor);
  for (const std::size_t i : {1, 5}) {
    EXPECT_LT(ComparePoses(*updated.sensors[i].structure_from_sensor,
                           *last.sensors[i == 5 ? 0 : 1].structure_from_sensor)
                  .translation_m,
              1e-6);
    EXPECT_GT(updated.sensors[i].covariance.trace(), last.sensors[3].covariance.trace());
  }
  EXPECT_EQ(nlohmann::json::parse(RigCheckText(check, "check"))["sensors"][0].count("found_from_m"),
            0u);

  options.moved = {"S1", "S4"};
  ExpectError<DataError>([&] { CheckRig("last.json", last, now, options); },
                         {"\"S4\"", "last.json"});
}

TEST(RigCheck, NamesWhatMovedAndUpdatesThatAlone) {
  const Pose last_from_now = Moved(0.5, 0.7);
  const Extrinsics last = Rig(Pose::Identity());
  Extrinsics now = Rig(last_from_now);
  const Pose before_from_after = MakePose({0, 0, 0}, {0.05, 0, 0});
  now.sensors[1].structure_from_sensor = *now.sensors[1].structure_from_sensor * before_from_after;
  now.sensors[1].together = Moved(0.3, 0.1);
  now.captures = {"now.json"};
  now.pairs[1].rms_m = 0.009;
  now.pairs[2].rms_m = 0.009;

  const RigCheck check = CheckRig("last.json", last, now);
  const std::string text = FormatRigCheck(check);
  EXPECT_TRUE(Has(text, "S1 moved 50.0 mm, 0.00 deg; the other 3 agree within 0.0 mm, 0.00 deg",
                  "S4 is not compared: it failed last time (no_depth): it has no depth",
                  "the stack stands 539 mm and 40.1 deg from where it stood"));
  EXPECT_EQ(RigCheckSentences(check)[0].find("S1 moved 50.0 mm, 0.00 deg"), 0u);
  EXPECT_TRUE(check.MovedBeyond(0.049, 10));
  EXPECT_FALSE(check.MovedBeyond(0.051, 10));
  EXPECT_TRUE(check.MovedBeyond(0, 0));

  const Extrinsics updated = UpdateExtrinsics(last, now, check);
  ASSERT_EQ(updated.sensors.size(), 5u);
  for (const std::size_t i : {0, 2, 3})
    EXPECT_EQ(updated.sensors[i].structure_from_sensor->matrix(),
              last.sensors[i].structure_from_sensor->matrix());
  const Pose expected = *last.sensors[1].structure_from_sensor * before_from_after;
  EXPECT_LT(ComparePoses(*updated.sensors[1].structure_from_sensor, expected).translation_m, 1e-6);
  EXPECT_LT(
      ComparePoses(*updated.sensors[1].together, last_from_now * Moved(0.3, 0.1)).translation_m,
      1e-6);
  // Its own error, in the last frame, and that of where the last frame is.
  const Matrix6d turn = Adjoint(last_from_now);
  const Matrix6d own = turn * now.sensors[1].covariance * turn.transpose();
  EXPECT_LT(((updated.sensors[1].covariance - own) - check.movements.covariance).norm(),
            1e-6 * own.norm());
  EXPECT_GT(check.movements.covariance.norm(), 0.1 * own.norm());
  EXPECT_FALSE(updated.metrics);
  ASSERT_EQ(updated.pairs.size(), 3u);
  for (const PairResult& pair : updated.pairs) {
    EXPECT_EQ(pair.rms_m, pair.a == "S2" ? 0.003 : (pair.a == "S0" ? 0.001 : 0.009));
    // How well S1's new pose is known to the others' old ones nobody has measured.
    EXPECT_EQ(pair.covariance.allFinite(), pair.a == "S2");
  }
  ASSERT_EQ(updated.placements.size(), 2u);
  EXPECT_LT(ComparePoses(updated.placements[1].first_from_placement, last_from_now).translation_m,
            1e-6);

  const TempFolder folder;
  WriteExtrinsics(folder.path() / "updated.json", updated);
  const Extrinsics read = ReadExtrinsics(folder.path() / "updated.json");
  EXPECT_EQ(read.sensors.size(), 5u);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(read.pairs.at(i).covariance.allFinite(), updated.pairs[i].covariance.allFinite());
  WriteRigCheck(folder.path() / "check.json", check);
  const auto json = nlohmann::json::parse(ReadFile(folder.path() / "check.json"));
  EXPECT_EQ(json, nlohmann::json::parse(RigCheckText(check, "check")));
  EXPECT_EQ(json["sensors"][1]["movement"], "moved");
  EXPECT_NEAR(json["sensors"][1]["translation_m"], 0.05, 1e-6);
  EXPECT_EQ(json["not_compared"][0]["name"], "S4");
}

Vector6d Normal(RandomStream* random) {
  Vector6d draw;
  for (double& x : draw) x = random->Normal();
  return draw;
}

Vector6d Drawn(const Matrix6d& covariance, RandomStream* random) {
  return covariance.llt().matrixL() * Normal(random);
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

// The new placements stand in a structure frame whose place among the last sensors is uncertain,
// and they are uncertain themselves.
TEST(RigCheck, NewPlacementsKeepTheirOwnUncertainty) {
  const Pose last_from_now = Moved(0.5, 0.7);
  const Extrinsics last = Rig(Pose::Identity());
  Extrinsics now = Rig(last_from_now);
  RandomStream random(1, 0, "placements");
  for (const Pose& at : {Moved(-1.2, 2), Moved(0.8, -0.9)})
    now.placements.push_back({"later", "b.json", at, {}, {}, {"S0"}, {}, DrawCovariance(&random)});
  const RigCheck check = CheckRig("last.json", last, now);
  const Extrinsics updated = UpdateExtrinsics(last, now, check);
  ASSERT_EQ(updated.placements.size(), 4u);
  EXPECT_TRUE(updated.placements[1].covariance.isApprox(check.movements.covariance, 1e-9));
  const Matrix6d turn = Adjoint(*check.movements.last_from_now);
  for (const std::size_t k : {1, 2}) {
    const Extrinsics::Placement& found = updated.placements[k + 1];
    EXPECT_TRUE(found.covariance.isApprox(
        check.movements.covariance + turn * now.placements[k].covariance * turn.transpose(), 1e-9));
    EXPECT_TRUE(found.sigma_translation_m.isApprox(SigmaTranslation(found.covariance)));
    EXPECT_TRUE(found.sigma_rotation_deg.isApprox(SigmaRotationDeg(found.covariance)));
  }

  // A file of an earlier version has no covariances of placements, and gets none.
  const TempFolder folder;
  WriteExtrinsics(folder.path() / "updated.json", updated);
  EXPECT_TRUE(ReadExtrinsics(folder.path() / "updated.json")
                  .placements[2]
                  .covariance.isApprox(updated.placements[2].covariance, 1e-12));
  auto json = nlohmann::json::parse(ReadFile(folder.path() / "updated.json"));
  for (auto& placement : json["placements"]) placement.erase("covariance");
  WriteFileAtomically(folder.path() / "earlier.json", json.dump());
  const Extrinsics earlier = ReadExtrinsics(folder.path() / "earlier.json");
  EXPECT_TRUE(earlier.placements[2].covariance.array().isNaN().all());
  EXPECT_TRUE(earlier.placements[2].sigma_translation_m.isApprox(
      updated.placements[2].sigma_translation_m, 1e-12));
  WriteExtrinsics(folder.path() / "again.json", earlier);
  EXPECT_FALSE(
      nlohmann::json::parse(ReadFile(folder.path() / "again.json"))["placements"][2].contains(
          "covariance"));
}

TEST(RigCheck, SensorsThatAreNewOrPlacedForTheFirstTimeAreAdded) {
  const Extrinsics last = Rig(Pose::Identity());
  const Pose last_from_now = Moved(-0.1, 1);
  Extrinsics now = Rig(last_from_now);
  now.sensors[4] = now.sensors[0];
  now.sensors[4].name = "S4";
  now.sensors.push_back(now.sensors[3]);
  now.sensors.back().name = "S5";
  now.sensors.erase(now.sensors.begin() + 2);
  const RigCheck check = CheckRig("last.json", last, now);
  EXPECT_FALSE(check.MovedBeyond(0, 0));
  EXPECT_EQ(check.not_compared.size(), 3u);  // S2 now, S4 last time, S5 last time
  const Extrinsics updated = UpdateExtrinsics(last, now, check);
  ASSERT_EQ(updated.sensors.size(), 6u);
  EXPECT_EQ(updated.verdict, SensorStatus::kOk);
  const PoseError error =
      ComparePoses(*updated.sensors[5].structure_from_sensor, RingPose(80.0 * 3));
  EXPECT_LT(error.translation_m, 1e-6);
  EXPECT_TRUE(updated.sensors[2].structure_from_sensor);
}

TEST(RigCheck, TwoRigsAreAnErrorAndUndecidedMovementsAreNotUpdated) {
  const Extrinsics last = Rig(Pose::Identity());
  Extrinsics other = last;
  for (Extrinsics::Sensor& sensor : other.sensors) sensor.name += "x";
  ExpectError<DataError>([&] { CheckRig("last.json", last, other); },
                         {"no sensor of the same name"});

  Extrinsics now = last;
  for (const std::size_t i : {0, 1})
    now.sensors[i].structure_from_sensor = Moved(0.1, 0.2) * *now.sensors[i].structure_from_sensor;
  const RigCheck check = CheckRig("last.json", last, now);
  EXPECT_TRUE(check.MovedBeyond(10, 10));
  ExpectError<DataError>([&] { UpdateExtrinsics(last, now, check); }, {"it is unknown which"});
}

TEST(RigCheck, SaysThatTwoSensorsAreExchanged) {
  const Extrinsics last = Rig(Pose::Identity());
  Extrinsics now = Rig(Moved(0.5, 0.7));
  std::swap(now.sensors[1].structure_from_sensor, now.sensors[3].structure_from_sensor);
  const RigCheck check = CheckRig("last.json", last, now);
  EXPECT_TRUE(
      Has(FormatRigCheck(check), "S1 stands now where S3 stood, S3 stands now where S1 stood"));
  const auto json = nlohmann::json::parse(RigCheckText(check, "check.json"));
  EXPECT_EQ(json.at("exchanged").at(0).at("place_of"), "S3");
}

/// Two captures of sensors on a ring, with errors that their covariances describe; the structure
/// was moved between them.
struct Captures {
  std::vector<SensorEstimate> last, now;
  std::vector<Pose> true_last;
  Pose last_from_now = MakePose({0.02, 2.9, -0.01}, {0.4, 0.01, -0.7});

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
      const Vector6d error = Drawn(a.covariance, &random);
      a.structure_from_sensor = PerturbLeft(error, pose);
      const Pose now_from_last = last_from_now.inverse();
      const Matrix6d turn = Adjoint(now_from_last);
      b.covariance =
          turn * (same_errors ? a.covariance : DrawCovariance(&random)) * turn.transpose();
      const Vector6d other = same_errors ? Vector6d(turn * error) : Drawn(b.covariance, &random);
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

/// Share of sensors, none of which moved, that are said to have, and the mean variance factor.
std::pair<double, double> FalseAlarms(int sensors, int trials, const MovementOptions& options,
                                      int first_seed = 0) {
  double moved = 0, factor = 0;
  for (int trial = 0; trial < trials; ++trial) {
    const Captures captures(sensors, static_cast<std::uint64_t>(first_seed + trial));
    const Movements movements = FindMovements(captures.last, captures.now, options);
    moved += sensors - Count(movements, Movement::kStayed);
    factor += movements.variance_factor / trials;
  }
  return {moved / (trials * sensors), factor};
}

TEST(Movement, FalseAlarmsAreAsRareAsTheyShouldBe) {
  MovementOptions options;
  options.false_alarm = 0.02;
  for (const int sensors : {3, 8}) {
    const auto [share, factor] = FalseAlarms(sensors, 150, options);
    // Two tests, by the stated and by the shown variance, may both accuse.
    EXPECT_LT(share, 0.06) << sensors;
    EXPECT_GT(share, 0.02) << sensors;
    EXPECT_GT(factor, 0.7) << sensors;
  }
  // One in 100,000, if nothing else is said, and here of 4,800: with one in 1,000 five would be
  // expected.
  EXPECT_EQ(FalseAlarms(8, 600, {}, 10000).first, 0);
}

TEST(Movement, FindsTheSensorThatMovedWhereverTheStructureStands) {
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    Captures captures(8, seed);
    const int mover = static_cast<int>(seed % 8);
    const Pose before_from_after =
        MakePose(Eigen::Vector3d(0, 0.02, 0.01), Eigen::Vector3d(0.02, 0.02, -0.01));
    captures.Move(mover, before_from_after);
    const Movements movements = FindMovements(captures.last, captures.now);
    ASSERT_TRUE(movements.last_from_now);
    EXPECT_TRUE(
        Within(ComparePoses(*movements.last_from_now, captures.last_from_now), 0.005, 0.15));
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

TEST(Movement, WhatIsKnownToHaveMovedHasNoVote) {
  // Three of four moved alike: they would outvote the one that stayed.
  const Pose before_from_after = MakePose({0, 0.03, 0}, {0.2, 0, 0});
  Captures captures(4, 7);
  for (const int mover : {0, 1, 3}) captures.Move(mover, before_from_after);
  MovementOptions options;
  options.moved = {"S0", "S1", "S3"};
  EXPECT_FALSE(FindMovements(captures.last, captures.now, options).last_from_now);
  options.one_may_stay = true;
  const Movements movements = FindMovements(captures.last, captures.now, options);
  ASSERT_TRUE(movements.last_from_now);
  EXPECT_TRUE(Within(ComparePoses(*movements.last_from_now, captures.last_from_now), 0.02, 0.6));
  ASSERT_EQ(movements.sensors.size(), 4u);
  EXPECT_EQ(movements.sensors[0].name, "S2");
  EXPECT_EQ(movements.sensors[0].movement, Movement::kStayed);
  for (const std::size_t i : {1, 2, 3}) {
    EXPECT_EQ(movements.sensors[i].movement, Movement::kMoved);
    const auto index = static_cast<std::size_t>(std::stoi(movements.sensors[i].name.substr(1)));
    const Vector6d error = LeftDifference(movements.sensors[i].structure_from_sensor,
                                          captures.true_last[index] * before_from_after);
    EXPECT_LT(error.dot(movements.sensors[i].covariance.ldlt().solve(error)), 30);
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
      const Pose pose = MakePose({0, 1.0 * i, 0}, {0.1 * i, 0, 0});
      for (std::vector<SensorEstimate>* of : {&last, &now}) {
        sensor.structure_from_sensor = PerturbLeft(Drawn(covariance, &random), pose);
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
      captures.Move(5, MakePose(Eigen::Vector3d::Zero(), {0.006, 0, 0}));
      const Movements movements = FindMovements(captures.last, captures.now);
      (same_errors ? found : found_apart) += movements.sensors[5].movement == Movement::kMoved;
    }
  }
  EXPECT_GT(found, found_apart + 5);
}

TEST(Movement, WithoutAMajorityNothingIsDecided) {
  const Pose away = MakePose({0, 0.1, 0}, {0.1, 0, 0});
  Captures two(2, 1);
  EXPECT_EQ(Count(FindMovements(two.last, two.now), Movement::kStayed), 2);
  two.Move(1, away);
  EXPECT_EQ(Count(FindMovements(two.last, two.now), Movement::kUndecided), 2);
  EXPECT_FALSE(FindMovements(two.last, two.now).last_from_now);

  // A moved pair that keeps together is another rig, of the same size.
  Captures four(4, 2);
  for (const std::size_t i : {2, 3}) {
    four.now[i].structure_from_sensor =
        MakePose({0, 0.3, 0}, {0.2, 0, 0.1}) * four.now[i].structure_from_sensor;
  }
  EXPECT_EQ(Count(FindMovements(four.last, four.now), Movement::kUndecided), 4);

  Captures three(3, 1);
  three.Move(1, away);
  EXPECT_EQ(FindMovements(three.last, three.now).sensors[1].movement, Movement::kMoved);

  Captures one(1, 1);
  EXPECT_EQ(Count(FindMovements(one.last, one.now), Movement::kUndecided), 1);
  EXPECT_TRUE(FindMovements(one.last, {}).sensors.empty());
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
  const Pose off = MakePose({0, 0.02, 0}, {0.04, 0, 0});
  Captures two(4, 3), three(5, 4), none(6, 5);
  Exchange({1, 2}, &two.now);
  two.Move(1, off);
  Exchange({0, 2, 3}, &three.now);
  EXPECT_EQ(Sentence(FindExchanged(two.last, two.now)), "S2 at S1; S1 at S2; ");
  EXPECT_EQ(Sentence(FindExchanged(three.last, three.now)), "S2 at S0; S3 at S2; S0 at S3; ");
  none.Move(3, MakePose({0, 0.3, 0}, {0.5, 0, 0}));
  EXPECT_EQ(Sentence(FindExchanged(none.last, none.now)), "");
}

}  // namespace
}  // namespace volalign::rig_check_test

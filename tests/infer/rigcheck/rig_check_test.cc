#include "infer/rigcheck/rig_check.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/random.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::rig_check_test {
namespace {

using testing_infer::RingPose;

Pose Moved(double x_m, double yaw_rad) {
  Pose pose = Pose::Identity();
  pose.linear() = RotationExp(Eigen::Vector3d(0, yaw_rad, 0));
  pose.translation() = Eigen::Vector3d(x_m, 0, -0.2);
  return pose;
}

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
    sensor.intrinsics = sensor.intrinsics_given = testing_infer::Kinect();
    sensor.covariance.diagonal() << 4e-6, 4e-6, 4e-6, 1e-6, 1e-6, 1e-6;
    rig.sensors.push_back(sensor);
  }
  rig.pairs = {{"S0", "S1", 0.3, 0.001}, {"S1", "S2", 0.2, 0.002}, {"S2", "S3", 0.1, 0.003}};
  for (PairResult& pair : rig.pairs) pair.covariance = 1e-6 * Matrix6d::Identity();
  rig.placements = {{"", "capture.json", Pose::Identity(), {}, {}, {"S0"}, {}}};
  rig.metrics = SetDistances{};
  return rig;
}

TEST(RigCheck, NamesWhatMovedAndUpdatesThatAlone) {
  const Pose last_from_now = Moved(0.5, 0.7);
  const Extrinsics last = Rig(Pose::Identity());
  Extrinsics now = Rig(last_from_now);
  Pose before_from_after = Pose::Identity();
  before_from_after.translation().x() = 0.05;
  now.sensors[1].structure_from_sensor = *now.sensors[1].structure_from_sensor * before_from_after;
  now.sensors[1].together = Moved(0.3, 0.1);
  now.captures = {"now.json"};
  now.pairs[1].rms_m = 0.009;
  now.pairs[2].rms_m = 0.009;

  const RigCheck check = CheckRig("last.json", last, now);
  const std::string text = FormatRigCheck(check);
  EXPECT_NE(text.find("S1 moved 50.0 mm, 0.00 deg; the other 3 agree within 0.0 mm, 0.00 deg"),
            std::string::npos)
      << text;
  EXPECT_NE(text.find("S4 is not compared: it failed last time (no_depth): it has no depth"),
            std::string::npos)
      << text;
  EXPECT_NE(text.find("the stack stands 539 mm and 40.1 deg from where it stood"),
            std::string::npos)
      << text;
  EXPECT_EQ(RigCheckSentences(check)[0].find("S1 moved 50.0 mm, 0.00 deg"), 0u);
  EXPECT_TRUE(check.MovedBeyond(0.049, 10));
  EXPECT_FALSE(check.MovedBeyond(0.051, 10));
  EXPECT_TRUE(check.MovedBeyond(0, 0));

  const Extrinsics updated = UpdateExtrinsics(last, now, check);
  ASSERT_EQ(updated.sensors.size(), 5u);
  for (const std::size_t i : {0, 2, 3}) {
    EXPECT_EQ(updated.sensors[i].structure_from_sensor->matrix(),
              last.sensors[i].structure_from_sensor->matrix());
  }
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

/// A covariance of about `sigma_m` and `sigma_rad` whose components depend on each other.
Matrix6d Dependent(double sigma_m, double sigma_rad) {
  Matrix6d root = Matrix6d::Identity();
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < i; ++j) root(i, j) = 0.3 * std::sin(1.7 * i + 2.9 * j);
  }
  Vector6d sigmas;
  sigmas << sigma_m, 2 * sigma_m, sigma_m / 2, sigma_rad, 0.5 * sigma_rad, 1.5 * sigma_rad;
  root = sigmas.asDiagonal() * root;
  return root * root.transpose();
}

Vector6d Drawn(const Matrix6d& covariance, RandomStream* random) {
  Vector6d normal;
  for (double& x : normal) x = random->Normal();
  return covariance.llt().matrixL() * normal;
}

// The new placements stand in a structure frame whose place among the last sensors is uncertain,
// and they are uncertain themselves: against drawn errors of both.
TEST(RigCheck, NewPlacementsKeepTheirOwnUncertainty) {
  const Pose last_from_now = Moved(0.5, 0.7);
  const Extrinsics last = Rig(Pose::Identity());
  Extrinsics now = Rig(last_from_now);
  now.placements.push_back(
      {"second", "b.json", Moved(-1.2, 2), {}, {}, {"S0"}, {}, Dependent(0.004, 0.002)});
  now.placements.push_back(
      {"third", "c.json", Moved(0.8, -0.9), {}, {}, {"S0"}, {}, Dependent(0.001, 0.003)});
  const RigCheck check = CheckRig("last.json", last, now);
  const Extrinsics updated = UpdateExtrinsics(last, now, check);
  ASSERT_EQ(updated.placements.size(), 4u);
  EXPECT_TRUE(updated.placements[1].covariance.isApprox(check.movements.covariance, 1e-9));
  RandomStream random(1, 0, "placements");
  for (const std::size_t k : {1, 2}) {
    const Extrinsics::Placement& own = now.placements[k];
    const Extrinsics::Placement& found = updated.placements[k + 1];
    constexpr int kDraws = 40000;
    Matrix6d squares = Matrix6d::Zero();
    for (int i = 0; i < kDraws; ++i) {
      const Pose drawn =
          PerturbLeft(Drawn(check.movements.covariance, &random), *check.movements.last_from_now) *
          PerturbLeft(Drawn(own.covariance, &random), own.first_from_placement);
      const Vector6d delta = LeftDifference(found.first_from_placement, drawn);
      squares += delta * delta.transpose() / kDraws;
    }
    // Of whitened deltas, hence the identity to 1 / sqrt(draws) an element.
    const Eigen::LLT<Matrix6d> root(found.covariance);
    const Matrix6d half = root.matrixL().solve(squares);
    const Matrix6d white = root.matrixL().solve(Matrix6d(half.transpose()));
    EXPECT_LT((white - Matrix6d::Identity()).cwiseAbs().maxCoeff(), 0.04) << k << "\n" << white;
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
  ExpectError<DataError>([&] { UpdateExtrinsics(last, now, check); }, {"cannot be told"});
}

TEST(RigCheck, SaysThatTwoSensorsAreExchanged) {
  const Extrinsics last = Rig(Pose::Identity());
  Extrinsics now = Rig(Moved(0.5, 0.7));
  std::swap(now.sensors[1].structure_from_sensor, now.sensors[3].structure_from_sensor);
  const RigCheck check = CheckRig("last.json", last, now);
  EXPECT_NE(
      FormatRigCheck(check).find("S1 stands now where S3 stood, S3 stands now where S1 stood"),
      std::string::npos)
      << FormatRigCheck(check);
  const auto json = nlohmann::json::parse(RigCheckText(check, "check.json"));
  EXPECT_EQ(json.at("exchanged").at(0).at("place_of"), "S3");
}

}  // namespace
}  // namespace volalign::rig_check_test

#include "infer/report/world_frame.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <fstream>
#include <initializer_list>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::world_frame_test {
namespace {

using namespace testing_infer;

/// A robot's base with z up, 1.5 m away.
Pose RobotFromStructure() { return MakePose({M_PI / 2, 0.1, -0.2}, {1.5, -0.3, 0.8}); }
Pose HandFromStructure() { return MakePose({0.3, -2, 1}, {0.02, 0.05, 0.31}); }

Vector6d Normal(RandomStream* random) {
  Vector6d normal;
  for (double& value : normal) value = random->Normal();
  return normal;
}

double Square(const Pose& found, const Pose& truth, const Matrix6d& covariance) {
  const Vector6d error = LeftDifference(found, truth);
  return error.dot(covariance.ldlt().solve(error));
}

/// Corners of the paper's boxes in the robot's frame, with errors of `sigma`, m.
WorldObservation Touched(double sigma, RandomStream* random) {
  WorldObservation observation;
  observation.name = "robot";
  observation.sigma_m = 0.001;
  const Structure structure = PaperStructure();
  for (const auto& [box, corner] :
       {std::pair(0, "+++"), {0, "-+-"}, {1, "+++"}, {2, "+-+"}, {3, "---"}}) {
    const Box& of = structure.boxes()[static_cast<std::size_t>(box)];
    Eigen::Vector3d q = 0.5 * of.size;
    for (int i = 0; i < 3; ++i) q[i] *= corner[i] == '+' ? 1 : -1;
    Eigen::Vector3d p = RobotFromStructure() * (of.structure_from_box * q);
    for (int i = 0; i < 3; ++i) p[i] += sigma * random->Normal();
    observation.points.push_back({of.name, corner, p});
  }
  return observation;
}

TEST(WorldFrame, TouchedCorners) {
  RandomStream random(1, 0, "touched");
  double squares = 0, covariances = 0;
  constexpr int kTrials = 200;
  for (int trial = 0; trial < kTrials; ++trial) {
    const WorldFrame world = FindWorldFrame(Touched(0.001, &random), {}, PaperStructure());
    squares += Square(world.world_from_structure, RobotFromStructure(), world.covariance);
    covariances += world.covariance.trace();
    EXPECT_EQ(world.name, "robot");
  }
  EXPECT_NEAR(squares / kTrials, 5.3, 0.8);  // 6 less what VarianceFactor adds
  // Points that fit worse than they should are less exact.
  const WorldFrame worse = FindWorldFrame(Touched(0.01, &random), {}, PaperStructure());
  EXPECT_GT(worse.covariance.trace(), 20 * covariances / kTrials);
  EXPECT_GT(*worse.rms_m, 0.004);

  // The boxes stand where the capture shows them.
  CalibrationResult result;
  std::vector<Pose> offsets(PaperStructure().boxes().size(), MakePose({0, 0, 0}, {0.01, 0, 0}));
  result.built = PaperStructure().Displaced(offsets);
  const WorldFrame built = FindWorldFrame(Touched(0, &random), result, PaperStructure());
  EXPECT_LT((built.world_from_structure * Eigen::Vector3d(0.01, 0, 0) -
             RobotFromStructure().translation())
                .norm(),
            1e-9);
}

TEST(WorldFrame, CornersThatDoNotServe) {
  RandomStream random(1, 0, "touched");
  const WorldObservation good = Touched(0.001, &random);
  const auto refused = [&](const WorldObservation& observation,
                           std::initializer_list<std::string> words) {
    ExpectError<ConfigError>([&] { FindWorldFrame(observation, {}, PaperStructure()); }, words);
  };
  WorldObservation observation = good;
  observation.points.resize(2);
  refused(observation, {"three corners"});
  observation.points.push_back(observation.points[0]);
  refused(observation, {"not on one line"});
  observation = good;
  for (TouchedPoint& point : observation.points) point.xyz_m.x() *= -1;
  refused(observation, {"right-handed", "metres"});
  observation = good;
  observation.points[1].box = "lid";
  refused(observation, {"\"lid\""});
  observation.points[1] = good.points[1];
  observation.points[2].corner = "+x+";
  refused(observation, {"\"+x+\"", "three signs"});
}

struct Arm {
  std::vector<Pose> first_from_placement;
  WorldObservation observation;

  /// `turns`: rotation vectors of the hand.
  Arm(const std::vector<Eigen::Vector3d>& turns, double sigma_m, double sigma_deg,
      RandomStream* random) {
    observation.name = "robot";
    observation.sigma_m = 0.001;
    observation.sigma_deg = 0.05;
    const Pose first = RobotFromStructure();
    for (const Eigen::Vector3d& turn : turns) {
      const bool begin = first_from_placement.empty();
      const Pose placement =
          begin ? Pose::Identity()
                : MakePose(turn, {random->Uniform(-0.3, 0.3), random->Uniform(-0.3, 0.3), 0.1});
      first_from_placement.push_back(placement);
      Pose hand = first * placement * HandFromStructure().inverse();
      hand.translation() += sigma_m * Normal(random).head<3>();
      hand.linear() = RotationExp(sigma_deg * kDegree * Normal(random).head<3>()) * hand.linear();
      observation.world_from_carrier.push_back(hand);
    }
  }
};

const std::vector<Eigen::Vector3d>& Turns() {
  static const std::vector<Eigen::Vector3d> turns = {
      {0, 0, 0}, {0.3, 0.1, 0}, {-0.2, 1, 0.2}, {0, -1.2, 0.3}, {0.2, 2, -0.2}};
  return turns;
}

/// Captures with these placements, known worse along z and about x.
CalibrationResult Captured(const std::vector<Pose>& placements, RandomStream* random) {
  CalibrationResult result;
  for (const Pose& placement : placements) {
    CaptureResult capture;
    capture.sensors.resize(1);
    capture.sensors[0].structure_from_sensor = Pose::Identity();
    capture.first_from_placement = placement;
    if (!result.captures.empty()) {
      Vector6d sigmas;
      sigmas << 5e-4, 5e-4, 0.003, 0.0015, 3e-4, 3e-4;
      capture.covariance = sigmas.cwiseAbs2().asDiagonal();
      capture.first_from_placement = PerturbLeft(sigmas.cwiseProduct(Normal(random)), placement);
    }
    result.captures.push_back(std::move(capture));
  }
  return result;
}

TEST(WorldFrame, TheStructureInARobotsHand) {
  RandomStream random(2, 0, "arm");
  double squares = 0;
  constexpr int kTrials = 100;
  for (int trial = 0; trial < kTrials; ++trial) {
    const Arm arm(Turns(), 0.001, 0.05, &random);
    const WorldFrame world = FindWorldFrame(
        arm.observation, Captured(arm.first_from_placement, &random), PaperStructure());
    squares += Square(world.world_from_structure, RobotFromStructure(), world.covariance);
    EXPECT_TRUE(Within(ComparePoses(*world.carrier_from_structure, HandFromStructure()), 0.01, 1));
    EXPECT_LT(*world.rms_m, 0.006);
  }
  EXPECT_NEAR(squares / kTrials, 5.3, 1);
}

TEST(WorldFrame, CarriersThatDoNotServe) {
  RandomStream random(3, 0, "arm");
  const auto refused = [](const Arm& arm, const CalibrationResult& result,
                          std::initializer_list<std::string> words) {
    ExpectError<ConfigError>([&] { FindWorldFrame(arm.observation, result, PaperStructure()); },
                             words);
  };
  const Arm arm(Turns(), 0, 0, &random);
  CalibrationResult result = Captured(arm.first_from_placement, &random);
  for (const std::size_t i : {1, 2, 4}) result.captures[i].sensors[0].structure_from_sensor.reset();
  refused(arm, result, {"three captures"});
  result.captures.pop_back();
  refused(arm, result, {"5 poses", "4 captures"});
  const Arm upright({{0, 0, 0}, {0, 1, 0}, {0, 2, 0}, {0, -1, 0}}, 0, 0, &random);
  refused(upright, Captured(upright.first_from_placement, &random), {"two axes"});
  // The axis of half a turn may have either sign.
  const Arm flipped({{0, 0, 0}, {M_PI, 0, 0}, {0, M_PI, 0}}, 0, 0, &random);
  refused(flipped, Captured(flipped.first_from_placement, &random), {"10 to 170 degrees"});
}

TEST(WorldFrame, APoseHasItsOwnSigmas) {
  WorldObservation observation;
  observation.name = "room";
  observation.world_from_structure = MakePose({0, 0, 1}, {10, 0, 0});
  observation.sigma_m = 0.01;
  observation.sigma_deg = 1;
  const WorldFrame world = FindWorldFrame(observation, {}, PaperStructure());
  EXPECT_LT((SigmaPosition(world.world_from_structure, world.covariance) -
             Eigen::Vector3d::Constant(0.01))
                .norm(),
            1e-9);
  EXPECT_NEAR(SigmaRotationDeg(world.covariance).x(), 1, 1e-9);
  // A sensor 2 m from the structure is less certain in the world than the structure.
  const Pose sensor = *observation.world_from_structure * MakePose({0, 0, 0}, {0, 0, 2});
  EXPECT_NEAR(SigmaPosition(sensor, CovarianceInWorld(world, Matrix6d::Zero())).x(),
              std::hypot(0.01, 2 * kDegree), 1e-6);
  EXPECT_TRUE(
      Has(WorldSentence(world), "at +10.000, +0.000, +0.000 m in room", "sigma 10.0 mm, 1.00 deg"));
}

TEST(WorldFrame, Files) {
  const TempFolder folder;
  const auto read = [&](const std::string& text) {
    std::ofstream(folder.path() / "world.json") << text;
    return ReadWorldObservation(folder.path() / "world.json");
  };
  const std::string begin = R"({"format": "volalign.world/1", "name": "base", )";
  const std::string pose = "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";
  EXPECT_EQ(
      read(begin + "\"world_from_structure\": " + pose + ", \"sigma_m\": 0.1, \"sigma_deg\": 2}")
          .world_from_structure->translation(),
      Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(read(begin + "\"world_from_carrier\": [" + pose + ", " + pose +
                 "], \"sigma_m\": 0.1, \"sigma_deg\": 2}")
                .world_from_carrier.size(),
            2u);
  const WorldObservation touched =
      read(begin +
           R"("points": [{"box": "top", "corner": "+-+", "xyz_m": [1, 2, 3]}], "sigma_m": 0.001})");
  EXPECT_EQ(touched.points.at(0).xyz_m, Eigen::Vector3d(1, 2, 3));
  ExpectError<DataError>([&] { read(begin + "\"sigma_m\": 0.1, \"sigma_deg\": 2}"); },
                         {"world.json", "exactly one"});
  ExpectError<DataError>(
      [&] {
        read(begin + "\"world_from_structure\": " + pose + ", \"sigma_m\": 0, \"sigma_deg\": 2}");
      },
      {"above 0"});
  ExpectError<DataError>(
      [&] { read(begin + "\"world_from_structure\": " + pose + ", \"sigma_m\": 1}"); },
      {"sigma_deg"});
}

}  // namespace
}  // namespace volalign::world_frame_test

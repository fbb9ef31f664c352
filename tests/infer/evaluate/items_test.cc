#include "infer/evaluate/items.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::items_test {
namespace {

using testing_infer::PaperStructure;

/// Moving every box by one rigid motion moves the sensors by its inverse, as seen from the boxes.
TEST(Items, TheFrameAsBuiltFollowsTheBoxes) {
  Vector6d motion;
  motion << 0.006, 0, -0.004, 0, 0.005, 0;
  const Pose moved = PerturbLeft(motion, Pose::Identity());
  RigCapture capture;
  capture.structure = PaperStructure();
  capture.box_offsets.assign(capture.structure.boxes().size(), moved);
  const EvaluationStill still = StillOf(capture);
  EXPECT_LT((still.nominal_from_built.matrix() - moved.inverse().matrix()).norm(), 1e-9);
}

TEST(Items, StillsOfPlacementsKeepTheFrameOfTheFirst) {
  Vector6d motion;
  motion << 0.006, 0, -0.004, 0, 0.005, 0;
  std::vector<RigCapture> stills(2);
  for (RigCapture& still : stills) {
    still.structure = PaperStructure();
    still.box_offsets.assign(still.structure.boxes().size(), Pose::Identity());
    still.sensors.resize(1);
    still.sensors[0].labels = LabelImage(2, 2);
  }
  stills[1].box_offsets.assign(stills[0].box_offsets.size(), PerturbLeft(motion, Pose::Identity()));
  stills[1].sensors[0].structure_from_sensor.translation().x() = 3;
  stills[1].sensors[0].labels(1, 1) = 4;
  const EvaluationStill still = StillOf(stills);
  EXPECT_LT((still.nominal_from_built.matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-9);
  EXPECT_EQ(still.frames.at(0).ground_truth->translation().x(), 0);
  ASSERT_EQ(still.further.size(), 1u);
  EXPECT_EQ(still.further[0].frames.at(0).ground_truth->translation().x(), 3);
  EXPECT_EQ(still.further[0].labels.at(0)(1, 1), 4);
}

TEST(Items, SensorsAreCalibratedWithWhatTheCaptureStates) {
  RigCapture capture;
  capture.structure = PaperStructure();
  capture.box_offsets.assign(capture.structure.boxes().size(), Pose::Identity());
  CapturedSensor sensor;
  sensor.sensor = "azure_kinect_nfov_binned";
  sensor.stated_intrinsics = testing_infer::Kinect();
  sensor.intrinsics = testing_infer::Kinect();
  sensor.intrinsics.distortion = {0.1, 0, 0, 0};
  sensor.intrinsics.fx += 1;
  capture.sensors = {sensor};
  const EvaluationStill still = StillOf(capture);
  EXPECT_TRUE(still.frames.at(0).intrinsics == sensor.stated_intrinsics);
  EXPECT_EQ(still.frames.at(0).sensor, sensor.sensor);
}

class RigFiles : public testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"rig_ring.yaml", "arc.yaml"}) {
      series_.files.push_back(
          folder_
              .Write(name,
                     "seed: 4\nstructure_yaw_deg: 10\nsensors:\n"
                     "  - {name: A, sensor: realsense_d415, image_size: 320x180}\n")
              .string());
    }
  }
  std::vector<std::string> Names() {
    std::vector<std::string> names;
    for (const EvaluationItem& item : RigItems(ReadRigs(series_), series_, nullptr)) {
      names.push_back(item.rig + "/" + item.sensors + "/" + std::to_string(*item.seed));
    }
    return names;
  }
  /// structure_yaw_deg of the first item's rig, from its identity, the resolved rig.
  double Yaw() {
    const std::string identity = RigItems(ReadRigs(series_), series_, nullptr).at(0).identity;
    const std::string key = "structure_yaw_deg: ";
    return std::stod(identity.substr(identity.find(key) + key.size()));
  }

  TempFolder folder_;
  RigSeries series_;
};

TEST_F(RigFiles, EveryRigWithEverySensorAndSeed) {
  EXPECT_EQ(Names(), (std::vector<std::string>{"ring/as the rig/4", "arc/as the rig/4"}));
  series_.sensors = {"realsense_d415", "azure_kinect_nfov_binned"};
  series_.seeds = {7, 8};
  series_.files.resize(1);
  EXPECT_EQ(Names(), (std::vector<std::string>{"ring/realsense_d415/7", "ring/realsense_d415/8",
                                               "ring/azure_kinect_nfov_binned/7",
                                               "ring/azure_kinect_nfov_binned/8"}));
}

TEST_F(RigFiles, EachSeedTurnsTheStructureByAGoldenAngle) {
  // 360 deg (1 - 1 / golden ratio) a seed, four of them, on top of the rig's 10 deg.
  const double golden = 360 * (1 - 2 / (1 + std::sqrt(5.0)));
  EXPECT_NEAR(Yaw(), std::fmod(10 + 4 * golden, 360), 1e-6);
  series_.keep_yaw = true;
  EXPECT_EQ(Yaw(), 10);
}

TEST_F(RigFiles, EveryNumberOfPlacementsInTurn) {
  series_.files.resize(1);
  series_.placements = {1, 3};
  series_.seeds = {7, 8};
  std::vector<int> numbers;
  std::vector<std::string> identities;
  for (const EvaluationItem& item : RigItems(ReadRigs(series_), series_, nullptr)) {
    numbers.push_back(item.placements);
    identities.push_back(item.identity);
  }
  EXPECT_EQ(numbers, (std::vector<int>{1, 1, 3, 3}));
  // One placement is the rig as it was.
  series_.placements.clear();
  const std::vector<EvaluationItem> plain = RigItems(ReadRigs(series_), series_, nullptr);
  EXPECT_EQ(plain.at(0).identity, identities[0]);
  EXPECT_EQ(plain.at(1).identity, identities[1]);
  EXPECT_NE(identities[2], identities[3]);
  // A rig's own placements come first; what it has too many of is left out.
  series_.files = {folder_
                       .Write("rig_own.yaml",
                              "sensors: [{name: A}]\nplacements:\n  - {x_cm: 31, z_cm: 0}\n"
                              "  - {x_cm: 47, z_cm: 0}\n")
                       .string()};
  series_.seeds.clear();
  series_.keep_yaw = true;
  EXPECT_EQ(RigItems(ReadRigs(series_), series_, nullptr).at(0).placements, 3);
  series_.placements = {2, 5};
  const std::vector<EvaluationItem> own = RigItems(ReadRigs(series_), series_, nullptr);
  EXPECT_NE(own.at(0).identity.find("x_cm: 31"), std::string::npos);
  EXPECT_EQ(own.at(0).identity.find("x_cm: 47"), std::string::npos);
  EXPECT_NE(own.at(1).identity.find("x_cm: 47"), std::string::npos);
  EXPECT_EQ(own.at(1).placements, 5);
}

TEST_F(RigFiles, BadRigsAreErrors) {
  series_.changes = {"room_=1"};
  ExpectError<ConfigError>([&] { ReadRigs(series_); }, {"room_"});
  series_.changes.clear();
  series_.files[1] = series_.files[0];
  ExpectError<ConfigError>([&] { ReadRigs(series_); }, {"two are named ring"});
}

TEST(Items, ParsesSeeds) {
  EXPECT_EQ(ParseSeeds("3:6"), (std::vector<std::uint64_t>{3, 4, 5}));
  EXPECT_EQ(ParseSeeds("7"), (std::vector<std::uint64_t>{7}));
  EXPECT_EQ(ParseSeeds("9,1"), (std::vector<std::uint64_t>{9, 1}));
  for (const char* bad : {"", "3:", ":3", "3:3", "5:2", "a", "1,,2", "1,1", "-1", "1.5", "1:2:3"}) {
    ExpectError<ConfigError>([&] { ParseSeeds(bad); }, {"--seeds"});
  }
}

}  // namespace
}  // namespace volalign::items_test

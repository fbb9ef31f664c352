// Calibration without a network: initial poses come from the shape of the structure.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/random.h"
#include "infer/calib/calibrate.h"
#include "infer/capture/capture.h"
#include "infer/initial/agreement.h"
#include "tests/core/geometry/mesh_shapes.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/initial/geometry_frames.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_geometry_test {
namespace {

using namespace testing_infer;

/// Adds a sensor whose depths have noise, mounted one does not know how.
void AddNoisy(const Pose& pose, const Scene& scene, Rig* rig) {
  const std::size_t i = rig->frames.size();
  SensorFrame& frame = rig->Add(pose, scene);
  AddNoise(&frame.depth, 0.004, i);
  frame.quarter_turns = kAutoTurns;
}

TEST(CalibrateByGeometry, ObjectsOfOtherForms) {
  for (const mesh_shapes::Shape& shape :
       {mesh_shapes::Ell(), mesh_shapes::Lectern(), mesh_shapes::Housing()}) {
    SCOPED_TRACE(shape.name);
    Rig rig{mesh_shapes::StructureOf(shape), {}, {}};
    for (int i = 0; i < 3; ++i)
      AddNoisy(RingPose(30.0 + 110 * i, 2.0, 0.5, 90, {0, 0, 0}), {true, 3.0}, &rig);
    for (const FrameResult& sensor : CalibrateByShape(rig.frames, rig.structure).sensors) {
      SCOPED_TRACE(sensor.name);
      EXPECT_EQ(sensor.status, SensorStatus::kOk) << sensor.reason;
      ASSERT_TRUE(sensor.error.has_value());
      EXPECT_TRUE(Within(*sensor.error, 0.006, 0.3));
      // A single part has no place of its own, which would be 0.5 deg of this.
      EXPECT_LT(sensor.covariance.diagonal().maxCoeff(), 0.01 * 0.01);
    }
  }
}

TEST(CalibrateByGeometry, StandsInForANetworkThatFindsNothing) {
  Rig rig = ThreeSensors();
  for (std::uint8_t& label : rig.labels[1]) label = 0;
  const CalibrationResult both = CalibrateRig(rig);
  ASSERT_TRUE(both.sensors[1].error);
  EXPECT_LT(both.sensors[1].error->translation_m, 0.01);
  EXPECT_EQ(both.sensors[0].initial_source, PoseSource::kNetwork);
  EXPECT_EQ(both.sensors[1].initial_source, PoseSource::kGeometry);

  CalibrateOptions options;
  options.initial.method = PoseMethod::kNetwork;
  EXPECT_EQ(CalibrateRig(rig, options).sensors[1].code, SensorCode::kNoStructure);
}

/// The paper's stack on a table, in a room whose floor is 0.7 m lower.
Rig OnATable() {
  const Structure stack = PaperStructure();
  std::vector<Box> seen = stack.boxes();
  seen.push_back(Box::FromMinMax("table", {-0.9, -1.51, -0.8}, {0.7, -0.81, 0.8}));
  Rig rig{Structure::FromBoxes("on a table", seen), {}, {}};
  for (int i = 0; i < 4; ++i) {
    AddNoisy(RingPose(20.0 + 90 * i, 2.3, 0.5, 90, {-0.1, -0.2, 0}), {true, 3.0}, &rig);
    const SensorFrame& frame = rig.frames.back();
    rig.labels.back() = LabelsFromPose(MakeSensorView(frame.depth, frame.intrinsics), stack,
                                       *frame.ground_truth, SurfaceTolerance::AtPose(ErrorsOf("")))
                            .labels;
  }
  rig.structure = stack;
  return rig;
}

TEST(OnATable, OfWhichNothingIsSaidEverySensorIsPlaced) {
  const Rig rig = OnATable();
  for (const bool model : {true, false}) {
    const CalibrationResult result =
        model ? CalibrateRig(rig) : CalibrateByShape(rig.frames, rig.structure);
    EXPECT_EQ(result.verdict(), SensorStatus::kOk) << model;
    for (const FrameResult& sensor : result.sensors)
      EXPECT_TRUE(Within(*sensor.error, 0.02, 1)) << sensor.name;
  }
}

// Real frames of two Xtions, whose units differ in scale, and cartons on a table. The reference is
// known to 5 cm and 0.4 deg by itself.
TEST(RealCaptures, CartonsOnATableAreFoundByTwoXtions) {
  const char* captures = std::getenv("VOLALIGN_CAPTURES");
  ASSERT_NE(captures, nullptr) << "VOLALIGN_CAPTURES names the folder of the frames";
  const std::filesystem::path folder = std::filesystem::path(captures) / "table";
  const auto references = nlohmann::json::parse(std::ifstream(folder / "reference.json"));
  for (const std::string scene : {"cho11", "mai7"}) {
    SCOPED_TRACE(scene);
    const CalibrationResult result =
        CalibrateByShape(ReadCapture(folder / scene / "capture.json").sensors,
                         ReadStructure(folder / scene / "boxes.yaml"));
    ASSERT_EQ(result.sensors.size(), 2U);
    std::vector<Pose> poses;
    for (const FrameResult& sensor : result.sensors) {
      ASSERT_TRUE(sensor.structure_from_sensor.has_value()) << sensor.reason;
      poses.push_back(*sensor.structure_from_sensor);
    }
    Pose reference;
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) reference.matrix()(i, j) = references[scene][i][j].get<double>();
    }
    EXPECT_TRUE(Within(ComparePoses(poses[0].inverse() * poses[1], reference), 0.07, 1.2));
  }
}

/// A room full of boxes, none of them on another, that no stack is made of.
Structure ManyBoxes(std::uint64_t seed) {
  RandomStream random(seed, 0, "boxes");
  std::vector<Box> boxes;
  for (int i = 0; i < 16; ++i) {
    const Eigen::Vector3d size{random.Uniform(0.25, 0.6), random.Uniform(0.2, 1.2),
                               random.Uniform(0.25, 0.6)};
    const Eigen::Vector3d foot(-1.35 + 0.9 * (i % 4), 0, -1.35 + 0.9 * (i / 4));
    boxes.push_back(Standing("box" + std::to_string(i), size, foot, random.Uniform(-45, 45)));
  }
  return Structure::FromBoxes("many", boxes);
}

TEST(CalibrateByGeometry, NothingIsOkInARoomFullOfOtherBoxes) {
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    Rig rig{ManyBoxes(seed), {}, {}};
    for (int i = 0; i < 4; ++i)
      AddNoisy(RingPose(20.0 + 90 * i, 2.6, 1.4, 90, {0, 0.3, 0}), {true, 3.5}, &rig);
    for (const FrameResult& sensor : CalibrateByShape(rig.frames, PaperStructure()).sensors)
      EXPECT_NE(sensor.status, SensorStatus::kOk) << seed;
  }
}

// One of eight stereo sensors was turned over, and said to differ from the others by 16 mm. Here
// each is asked alone, so that the others do not tell up from down.
TEST(CalibrateByGeometry, NoStereoSensorIsTurnedOver) {
  for (const std::uint64_t seed : {1, 2}) {
    Rig rig{PaperStructure(), {}, {}};
    for (std::size_t i = 0; i < 8; ++i) {
      const auto k = static_cast<double>(i);
      rig.Add(RingPose(45 * k + 11 * static_cast<double>(seed), 1.7 + 0.1 * k,
                       0.2 + 0.2 * static_cast<double>(i % 4)),
              {true, 3.2}, {320, 180, 235.9, 235.9, 159.3, 88.0, {}});
      rig.frames[i].sensor = "realsense_d415";
      rig.frames[i].quarter_turns = kAutoTurns;
      AddNoise(&rig.frames[i].depth, 0.004, 10 * seed + i);
      AddSmoothError(&rig.frames[i].depth, 0.011, 20, 10 * seed + i);
    }
    int placed = 0;
    for (const SensorFrame& frame : rig.frames) {
      const FrameResult sensor = CalibrateByShape({frame}, rig.structure).sensors.front();
      SCOPED_TRACE(std::to_string(seed) + " " + sensor.name + ": " + sensor.reason);
      if (sensor.status == SensorStatus::kFailed) continue;
      ++placed;
      EXPECT_TRUE(Within(*sensor.error, 0.05, 2));
    }
    EXPECT_GE(placed, 6);
  }
}

// Which side of a row that looks alike from two sides a sensor stands on is a question of the rig:
// one of the two alone, taken for itself from behind, would see through what the other one sees,
// although walls and floor then lie in the same places. Both sensors have one other set of poses,
// at the other side of the row, which --choose chooses for both by either.
TEST(CalibrateAlternatives, TheOtherSideIsInTheResultAndCanBeChosen) {
  const Rig rig = RowInARoom(100);
  CalibrateOptions options;
  const auto calibrate = [&] { return CalibrateByShape(rig.frames, rig.structure, options); };
  const CalibrationResult first = calibrate();
  const auto between = [](const auto& a, const auto& b) { return Pose(a->inverse() * *b); };
  EXPECT_TRUE(Within(ComparePoses(between(first.sensors.at(0).structure_from_sensor,
                                          first.sensors.at(1).structure_from_sensor),
                                  between(rig.frames[0].ground_truth, rig.frames[1].ground_truth)),
                     0.03, 0.3));
  for (const FrameResult& sensor : first.sensors)
    EXPECT_EQ(sensor.code, SensorCode::kAmbiguous) << "both may be turned together";
  ASSERT_FALSE(first.alternatives.empty());
  const RigAlternative& alternative = first.alternatives.front();
  ASSERT_EQ(alternative.sensors.size(), 2u) << "neither turns without the other";
  EXPECT_LT(alternative.log_odds, std::log(kDecisiveOdds));
  options.orientation.choose = {"S1=2"};
  const CalibrationResult second = calibrate();
  for (std::size_t i = 0; i < 2; ++i) {
    const FrameResult& sensor = second.sensors[i];
    ASSERT_TRUE(sensor.structure_from_sensor.has_value());
    EXPECT_LT(
        ComparePoses(*sensor.structure_from_sensor, alternative.sensors[i].structure_from_sensor)
            .translation_m,
        0.05);
    EXPECT_NE(sensor.code, SensorCode::kAmbiguous) << "the choice is made";
  }
  for (const char* wrong : {"S1=9", "S1", "S1=0", "S1=x", "S9=2"}) {
    options.orientation.choose = {wrong};
    EXPECT_THROW(calibrate(), ConfigError) << wrong;
  }
}

}  // namespace
}  // namespace volalign::calibrate_geometry_test

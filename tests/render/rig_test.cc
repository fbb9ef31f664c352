#include "render/rig.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_util.h"
#include "core/image_io.h"
#include "core/lens.h"
#include "core/structure_gltf.h"
#include "core/visibility.h"
#include "render/capture_writer.h"
#include "render/depth_renderer.h"
#include "render/egl_context.h"
#include "tests/core/expect_error.h"
#include "tests/render/test_scene.h"

namespace volalign {
namespace {

class RigTest : public testing::Test {
 protected:
  RigTest()
      : dir_(std::filesystem::temp_directory_path() /
             ("volalign_rig_test_" + std::to_string(getpid()))) {}
  ~RigTest() override { std::filesystem::remove_all(dir_); }

  static Rig Parse(const std::string& yaml) {
    return ReadRig(ConfigSource::FromString(yaml, "test.yaml"));
  }
  static std::string ErrorOf(const std::string& yaml) {
    try {
      Parse(yaml);
    } catch (const ConfigError& error) {
      return error.what();
    }
    return "";
  }

  std::filesystem::path dir_;
  EglContext egl_;
  DepthRenderer renderer_;
};

const char* const kTwo =
    "structure_yaw_deg: 30\nseed: 5\nsensors:\n"
    "  - {name: A, sensor: realsense_d415, rho_cm: 210, phi_deg: 40, height_cm: 95}\n"
    "  - {name: B, sensor: azure_kinect_nfov_binned, rho_cm: 190, phi_deg: 200, height_cm: 120, "
    "roll_deg: 0}\n";

TEST_F(RigTest, PosesHaveTheirClosedForm) {
  RigSensor sensor;
  sensor.rho_cm = 200;
  sensor.phi_deg = 90;
  sensor.height_cm = 81;
  sensor.roll_deg = 0;
  // At z = 2 m, looking along -z: x to the right is -x... the sensor faces the structure, its right
  // hand is +x.
  Pose expected = Pose::Identity();
  expected.linear() << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  expected.translation() = Eigen::Vector3d(0, 0, 2);
  EXPECT_TRUE(RigSensorPose(sensor, 0, -0.81).matrix().isApprox(expected.matrix(), 1e-9));
  // The structure turned by +90 deg about y (z to x) sees that sensor at its own -x... R_y(-90) (0,
  // 0, 2) = (-2, 0, 0).
  EXPECT_TRUE(
      RigSensorPose(sensor, 90, -0.81).translation().isApprox(Eigen::Vector3d(-2, 0, 0), 1e-9));
}

TEST_F(RigTest, WrittenCaptureReadsBack) {
  const RigCapture capture = RenderRig(Parse(kTwo), renderer_);
  WriteCapture(dir_, capture);
  const auto json = nlohmann::json::parse(ReadFile(dir_ / "capture.json"));
  EXPECT_EQ(json.at("format"), "volalign.capture/1");
  ASSERT_EQ(json.at("sensors").size(), 2u);
  EXPECT_EQ(ReadStructureGlb(dir_ / json.at("structure").get<std::string>()).Hash(),
            capture.structure.Hash());
  for (std::size_t i = 0; i < 2; ++i) {
    const auto& entry = json.at("sensors").at(i);
    const CapturedSensor& sensor = capture.sensors[i];
    EXPECT_EQ(entry.at("name"), sensor.name);
    EXPECT_EQ(entry.at("sensor"), i == 0 ? "realsense_d415" : "azure_kinect_nfov_binned");
    const auto& k = entry.at("intrinsics");
    EXPECT_EQ(k.at("width"), sensor.depth.width());
    EXPECT_EQ(k.at("height"), sensor.depth.height());
    EXPECT_EQ(k.at("fx"), sensor.intrinsics.fx);
    EXPECT_EQ(k.at("cy"), sensor.intrinsics.cy);
    EXPECT_EQ(k.at("distortion").size(), i == 0 ? 0U : 8U);
    EXPECT_EQ(k.at("distortion").get<std::vector<double>>(), sensor.intrinsics.distortion);
    const DepthImage depth = ToMetres(ReadDepthFile(dir_ / entry.at("depth").get<std::string>()),
                                      json.at("depth_scale"));
    ASSERT_EQ(depth.size(), sensor.depth.size());
    for (std::size_t p = 0; p < depth.size(); ++p) {
      EXPECT_NEAR(depth[p], sensor.depth[p], 1e-5);
    }
    EXPECT_TRUE(ReadPng8(dir_ / (sensor.name + "_labels.png")) == sensor.labels);
    const Pose pose = PoseFromRows(
        json.at("ground_truth").at(sensor.name).get<std::vector<std::vector<double>>>(), "test");
    EXPECT_TRUE(pose.matrix().isApprox(sensor.structure_from_sensor.matrix(), 1e-9));
  }
  EXPECT_EQ(capture.sensors[0].depth.width(), 320);
  EXPECT_EQ(capture.sensors[0].depth.height(), 180);
  EXPECT_EQ(capture.sensors[1].depth.height(), 288);
  EXPECT_GT(ReadPngRgb(dir_ / "contact_sheet.png").width(), 600);
}

TEST_F(RigTest, GroundTruthReprojects) {
  const RigCapture capture =
      RenderRig(Parse(std::string("room: false\nnoise: none\n") + kTwo), renderer_);
  for (const CapturedSensor& sensor : capture.sensors) {
    const StructureView truth =
        CastView(capture.structure, ComputeRays(sensor.intrinsics), sensor.structure_from_sensor);
    long compared = 0, equal = 0, structure = 0;
    for (int v = 0; v < sensor.depth.height(); ++v) {
      for (int u = 0; u < sensor.depth.width(); ++u) {
        if (IsEdge(truth.labels, truth.depth, u, v)) continue;
        ++compared;
        structure += truth.labels(u, v) != 0;
        equal += truth.labels(u, v) == sensor.labels(u, v) &&
                 std::abs(truth.depth(u, v) - sensor.depth(u, v)) < 1e-4F;
      }
    }
    EXPECT_GT(structure, 4000);
    EXPECT_GT(static_cast<double>(equal) / compared, 0.9995);
  }
}

TEST_F(RigTest, TheCaptureLeavesOutALensThatIsNotStated) {
  const RigCapture stated = RenderRig(Parse(kTwo), renderer_);
  const RigCapture silent = RenderRig(Parse(std::string("state_lens: false\n") + kTwo), renderer_);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_TRUE(silent.sensors[i].depth == stated.sensors[i].depth);
    EXPECT_TRUE(silent.sensors[i].intrinsics == stated.sensors[i].intrinsics);
    EXPECT_TRUE(stated.sensors[i].stated_intrinsics == stated.sensors[i].intrinsics);
    EXPECT_TRUE(silent.sensors[i].stated_intrinsics.distortion.empty());
    EXPECT_EQ(silent.sensors[i].stated_intrinsics.fx, stated.sensors[i].intrinsics.fx);
  }
  WriteCapture(dir_, silent);
  const auto json = nlohmann::json::parse(ReadFile(dir_ / "capture.json"));
  EXPECT_TRUE(json.at("sensors").at(1).at("intrinsics").at("distortion").empty());
}

TEST_F(RigTest, LensSpreadIsThatOfFocalLengthsAndRadialFactors) {
  const auto factor = [](const Intrinsics& k) {
    return (ProjectRay(k, {0.6, 0}).x() - k.cx) / (0.6 * k.fx);
  };
  std::vector<double> focal, radial;
  double both = 0;
  for (int seed = 1; seed <= 60; ++seed) {
    const RigCapture capture = RenderRig(
        Parse("room: false\nnoise: none\nlens_spread_percent: 0.5\nseed: " + std::to_string(seed) +
              "\nsensors:\n"
              "  - {name: A, sensor: realsense_d415, image_size: 32x18}\n"
              "  - {name: B, sensor: azure_kinect_nfov_binned, image_size: 20x18}\n"),
        renderer_);
    for (const CapturedSensor& sensor : capture.sensors) {
      focal.push_back(sensor.intrinsics.fx / sensor.stated_intrinsics.fx - 1);
      radial.push_back(factor(sensor.intrinsics) / factor(sensor.stated_intrinsics) - 1);
      both += focal.back() * radial.back();
      EXPECT_DOUBLE_EQ(sensor.intrinsics.fy / sensor.stated_intrinsics.fy, 1 + focal.back());
      EXPECT_EQ(sensor.intrinsics.cx, sensor.stated_intrinsics.cx);
    }
  }
  for (const std::vector<double>* values : {&focal, &radial}) {
    double sum = 0, squares = 0;
    for (const double x : *values) {
      sum += x;
      squares += x * x;
    }
    EXPECT_NEAR(std::sqrt(squares / 120), 0.005, 0.0013);  // 4 sigma of its own
    EXPECT_NEAR(sum / 120, 0, 0.0019);
  }
  EXPECT_NEAR(both / 120 / (0.005 * 0.005), 0, 0.4);  // drawn independently
}

TEST_F(RigTest, SensorsShareTheRoomButNotTheNoise) {
  const RigCapture capture =
      RenderRig(Parse("tripods: false\nsensors:\n"
                      "  - {name: A, sensor: azure_kinect_nfov_binned, image_size: 160x144}\n"
                      "  - {name: B, sensor: azure_kinect_nfov_binned, image_size: 160x144, "
                      "phi_deg: 0.0001}\n"),
                renderer_);
  const CapturedSensor& a = capture.sensors[0];
  const CapturedSensor& b = capture.sensors[1];
  // Intrinsics of the pool differ by up to 11 px of 320; the histograms of clean depths do not.
  std::vector<float> za(a.depth_clean.begin(), a.depth_clean.end());
  std::vector<float> zb(b.depth_clean.begin(), b.depth_clean.end());
  std::sort(za.begin(), za.end());
  std::sort(zb.begin(), zb.end());
  for (const double q : {0.1, 0.25, 0.5, 0.75}) {
    const auto i = static_cast<std::size_t>(q * static_cast<double>(za.size()));
    EXPECT_NEAR(za[i], zb[i], 0.15 * za[i]);
  }
  EXPECT_FALSE(a.depth == b.depth);
}

TEST_F(RigTest, RoomWithoutStructureAndSensorThatLooksAway) {
  const RigCapture empty =
      RenderRig(Parse(std::string("structure_present: false\n") + kTwo), renderer_);
  for (const CapturedSensor& sensor : empty.sensors) {
    EXPECT_EQ(*std::max_element(sensor.labels_clean.begin(), sensor.labels_clean.end()), 0);
    EXPECT_GT(
        std::count_if(sensor.depth.begin(), sensor.depth.end(), [](float z) { return z > 0; }),
        5000);
  }
  WriteCapture(dir_, empty);
  EXPECT_FALSE(nlohmann::json::parse(ReadFile(dir_ / "capture.json")).contains("ground_truth"));

  const RigCapture away = RenderRig(
      Parse("sensors:\n  - {name: A, phi_deg: 0, look_at_cm: [600, 0, 100]}\n"), renderer_);
  EXPECT_EQ(
      *std::max_element(away.sensors[0].labels_clean.begin(), away.sensors[0].labels_clean.end()),
      0);
}

TEST_F(RigTest, SameSeedSameBytes) {
  const Rig rig = Parse(kTwo);
  const RigCapture first = RenderRig(rig, renderer_), second = RenderRig(rig, renderer_);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_TRUE(first.sensors[i].depth == second.sensors[i].depth);
    EXPECT_TRUE(first.sensors[i].labels == second.sensors[i].labels);
  }
}

TEST_F(RigTest, ShippedRigIsValid) {
  const Rig rig = ReadRig(ConfigSource::FromFile("configs/rig_ring8.yaml"));
  EXPECT_EQ(rig.sensors.size(), 8u);
}

TEST_F(RigTest, ErrorsNameTheSensor) {
  EXPECT_NE(ErrorOf("room: true\n").find("sensors"), std::string::npos);
  EXPECT_NE(ErrorOf("sensors: [{name: A}, {name: A}]\n").find("A stands twice"), std::string::npos);
  EXPECT_NE(ErrorOf("sensors: [{name: ../A}]\n").find("../A"), std::string::npos);
  EXPECT_NE(ErrorOf("sensors: [{name: A, rho: 3}]\n").find("rho"), std::string::npos);
  // A rig is one still: its room and structure are there or not.
  for (const std::string key : {"room_probability", "structure_probability"}) {
    EXPECT_NE(ErrorOf("sensors: [{name: A}]\nscene: {" + key + ": 0.5}\n").find("scene." + key),
              std::string::npos);
  }
  ExpectError<IoError>(
      [&] { RenderRig(Parse("structure: none.yaml\nsensors: [{name: A}]\n"), renderer_); },
      {"structure = none.yaml", std::filesystem::current_path().string(), "--set structure=FILE"});
  EXPECT_THROW(RenderRig(Parse("sensors: [{name: A, sensor: lidar}]\n"), renderer_), ConfigError);
}

TEST_F(RigTest, UprightTurnsFollowTheMounting) {
  for (int turns = 0; turns < 4; ++turns) {
    RigSensor sensor;
    sensor.roll_deg = 90 * turns;
    EXPECT_EQ(UprightTurns(RigSensorPose(sensor, 0, -0.81)), turns);
  }
}

}  // namespace
}  // namespace volalign

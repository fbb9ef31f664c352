#include "infer/report/rig_gltf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::rig_gltf_test {
namespace {

using nlohmann::json;
using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

std::uint32_t Word(const std::string& bytes, std::size_t at) {
  std::uint32_t word = 0;
  for (std::size_t i = 4; i-- > 0;) word = word << 8 | static_cast<std::uint8_t>(bytes.at(at + i));
  return word;
}

/// A .glb taken apart by the specification (glTF 2.0, sections 3 and 4), with the checks that its
/// validator makes of what we write.
struct Glb {
  json document;
  std::string binary;

  explicit Glb(const std::string& bytes) {
    EXPECT_EQ(bytes.substr(0, 4), "glTF");
    EXPECT_EQ(Word(bytes, 4), 2u);
    EXPECT_EQ(Word(bytes, 8), bytes.size());
    const std::size_t length = Word(bytes, 12);
    EXPECT_EQ(bytes.substr(16, 4), "JSON");
    EXPECT_EQ(length % 4, 0u);
    document = json::parse(bytes.substr(20, length));
    const std::size_t at = 20 + length;
    EXPECT_EQ(bytes.substr(at + 4, 4), std::string("BIN\0", 4));
    EXPECT_EQ(Word(bytes, at) % 4, 0u);
    EXPECT_EQ(at + 8 + Word(bytes, at), bytes.size());
    binary = bytes.substr(at + 8);
    EXPECT_EQ(document["asset"]["version"], "2.0");
    EXPECT_LE(document["buffers"][0]["byteLength"].get<std::size_t>(), binary.size());
    CheckTree();
    for (const json& accessor : document["accessors"]) CheckAccessor(accessor);
  }

  /// Every node has one parent at most, and is reached from the scene.
  void CheckTree() {
    std::vector<int> reached(document["nodes"].size(), 0);
    std::vector<std::size_t> open = document["scenes"][0]["nodes"];
    while (!open.empty()) {
      const std::size_t node = open.back();
      open.pop_back();
      ASSERT_LT(node, reached.size());
      ASSERT_EQ(++reached[node], 1);
      for (const json& child : document["nodes"][node].value("children", json::array()))
        open.push_back(child);
    }
    EXPECT_EQ(std::count(reached.begin(), reached.end(), 1),
              static_cast<std::ptrdiff_t>(reached.size()));
  }

  static std::size_t Components(const json& accessor) {
    const std::string type = accessor["type"];
    return type == "SCALAR" ? 1 : static_cast<std::size_t>(type.at(3) - '0');
  }
  static std::size_t Size(const json& accessor) {
    const int component = accessor["componentType"];
    return component == 5126 ? 4 : component == 5123 ? 2 : 1;
  }

  void CheckAccessor(const json& accessor) const {
    const json& view = document["bufferViews"].at(accessor["bufferView"].get<std::size_t>());
    const std::size_t offset = view.value("byteOffset", std::size_t{0});
    const std::size_t begin = accessor.value("byteOffset", std::size_t{0});
    const std::size_t bytes =
        accessor["count"].get<std::size_t>() * Components(accessor) * Size(accessor);
    EXPECT_GT(accessor["count"].get<std::size_t>(), 0u);
    EXPECT_EQ((offset + begin) % Size(accessor), 0u);
    EXPECT_LE(begin + bytes, view["byteLength"].get<std::size_t>());
    EXPECT_LE(offset + view["byteLength"].get<std::size_t>(),
              document["buffers"][0]["byteLength"].get<std::size_t>());
    if (!accessor.contains("min")) return;
    const std::vector<float> values = Floats(accessor);
    for (std::size_t k = 0; k < 3; ++k) {
      float low = values[k], high = values[k];
      for (std::size_t i = k; i < values.size(); i += 3) {
        low = std::min(low, values[i]);
        high = std::max(high, values[i]);
      }
      EXPECT_FLOAT_EQ(accessor["min"][k].get<float>(), low);
      EXPECT_FLOAT_EQ(accessor["max"][k].get<float>(), high);
    }
  }

  std::vector<float> Floats(const json& accessor) const {
    EXPECT_EQ(accessor["componentType"], 5126);
    const json& view = document["bufferViews"].at(accessor["bufferView"].get<std::size_t>());
    std::vector<float> values(accessor["count"].get<std::size_t>() * Components(accessor));
    std::memcpy(values.data(), binary.data() + view.value("byteOffset", std::size_t{0}),
                4 * values.size());
    return values;
  }

  const json& Node(const std::string& name) const {
    for (const json& node : document["nodes"]) {
      if (node.value("name", "") == name) return node;
    }
    ADD_FAILURE() << "no node " << name;
    return document;
  }
  const json& Primitive(const std::string& node) const {
    return document["meshes"].at(Node(node)["mesh"].get<std::size_t>())["primitives"][0];
  }
};

Pose PoseOf(const json& node) {
  Pose pose = Pose::Identity();
  if (node.contains("translation")) {
    for (int i = 0; i < 3; ++i)
      pose.translation()[i] = node["translation"][static_cast<std::size_t>(i)];
  }
  if (node.contains("rotation")) {
    const json& q = node["rotation"];
    pose.linear() = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).toRotationMatrix();
  }
  return pose;
}

Extrinsics TwoSensors() {
  Extrinsics extrinsics;
  extrinsics.sensors.resize(2);
  extrinsics.sensors[0].name = "left";
  extrinsics.sensors[0].status = SensorStatus::kOk;
  extrinsics.sensors[0].structure_from_sensor = RingPose(30);
  extrinsics.sensors[0].intrinsics = Kinect();
  extrinsics.sensors[1].name = "lost";
  extrinsics.sensors[1].intrinsics = Kinect();
  extrinsics.placements.resize(2);
  extrinsics.placements[0].name = "here";
  extrinsics.placements[1].name = "there";
  extrinsics.placements[1].first_from_placement.translation() = Eigen::Vector3d(1, 0, 2);
  extrinsics.placements[1].sensors = {"left"};
  return extrinsics;
}

TEST(RigGlb, HasStackSensorsAsCamerasAndClouds) {
  const TempFolder folder;
  const Structure structure = PaperStructure();
  AlignedPoint point;
  point.p = {0.1f, -0.2f, 0.3f};
  point.colour = {1, 2, 3};
  AlignedPoint other;
  other.p = {-1, 2, 0.5f};
  WriteRigGlb(folder / "rig.glb", TwoSensors(), {structure, structure},
              {{"left", "here", {point, other}}, {"lost", "here", {}}});
  const Glb glb(ReadFile(folder / "rig.glb"));

  const json& sensor = glb.Node("left");
  const json& camera = glb.document["nodes"].at(sensor["children"][0].get<std::size_t>());
  const json& optics = glb.document["cameras"].at(camera["camera"].get<std::size_t>());
  EXPECT_EQ(optics["type"], "perspective");
  // Half the height over the focal length is the tangent of half the angle.
  EXPECT_NEAR(std::tan(optics["perspective"]["yfov"].get<double>() / 2), 144 / 252.2, 1e-9);
  EXPECT_NEAR(optics["perspective"]["aspectRatio"].get<double>(), 320.0 / 288, 1e-9);
  // A glTF camera looks along -z: two metres before the sensor along its axis.
  const Eigen::Vector3d ahead = PoseOf(sensor) * PoseOf(camera) * Eigen::Vector3d(0, 0, -2);
  EXPECT_LT((ahead - RingPose(30) * Eigen::Vector3d(0, 0, 2)).norm(), 1e-9);
  // ... with its y upwards in the picture.
  const Eigen::Vector3d up = PoseOf(sensor) * PoseOf(camera) * Eigen::Vector3d(0, 1, 0);
  EXPECT_LT((up - RingPose(30) * Eigen::Vector3d(0, -1, 0)).norm(), 1e-9);
  EXPECT_EQ(sensor["extras"]["status"], "ok");
  EXPECT_EQ(sensor["extras"]["structure_from_sensor"].size(), 16u);
  EXPECT_NEAR(sensor["extras"]["structure_from_sensor"][7].get<double>(), 0.4, 1e-12);
  EXPECT_NEAR(sensor["extras"]["intrinsics"]["cy"].get<double>(), 168.2, 1e-12);

  // The pyramid's corners are where the picture's are.
  const json& pyramid = glb.document["accessors"].at(
      glb.Primitive("left")["attributes"]["POSITION"].get<std::size_t>());
  const std::vector<float> corners = glb.Floats(pyramid);
  ASSERT_EQ(corners.size(), 15u);
  const double places[4][2] = {{-0.5, -0.5}, {319.5, -0.5}, {319.5, 287.5}, {-0.5, 287.5}};
  for (std::size_t i = 0; i < 4; ++i) {
    const float* corner = &corners[3 + 3 * i];
    const Eigen::Vector3d expected =
        RingPose(30) *
        (0.3 * Eigen::Vector3d((places[i][0] - 163.9) / 252.2, (places[i][1] - 168.2) / 252.2, 1));
    EXPECT_LT((PoseOf(sensor) * Eigen::Vector3d(corner[0], corner[1], corner[2]) - expected).norm(),
              1e-6)
        << i;
  }

  const json& points = glb.Primitive("left points in here");
  EXPECT_EQ(points["mode"], 0);
  const json& positions =
      glb.document["accessors"].at(points["attributes"]["POSITION"].get<std::size_t>());
  EXPECT_EQ(glb.Floats(positions), (std::vector<float>{0.1f, -0.2f, 0.3f, -1, 2, 0.5f}));
  const json& colours =
      glb.document["accessors"].at(points["attributes"]["COLOR_0"].get<std::size_t>());
  EXPECT_EQ(colours["normalized"], true);
  EXPECT_EQ(colours["type"], "VEC4");

  std::size_t boxes = 0;
  for (const json& node : glb.document["nodes"]) boxes += node.value("name", "") == "top";
  EXPECT_EQ(boxes, 2u);
  EXPECT_LT(
      (PoseOf(glb.Node(structure.name() + " in there")).translation() - Eigen::Vector3d(1, 0, 2))
          .norm(),
      1e-12);
  for (const json& node : glb.document["nodes"]) EXPECT_NE(node.value("name", ""), "lost");
}

TEST(RigGlb, AStillThatNoSensorTellsOfHasNoStack) {
  const TempFolder folder;
  Extrinsics extrinsics = TwoSensors();
  extrinsics.placements[1].sensors.clear();
  WriteRigGlb(folder / "rig.glb", extrinsics, {PaperStructure(), PaperStructure()}, {});
  const Glb glb(ReadFile(folder / "rig.glb"));
  for (const json& node : glb.document["nodes"])
    EXPECT_EQ(node.value("name", "").find("there"), std::string::npos);
}

}  // namespace
}  // namespace volalign::rig_gltf_test

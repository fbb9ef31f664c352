#include "core/formats/gltf_parts.h"

#include <gtest/gtest.h>

#include <cstring>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "tests/core/base/read_file.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::gltf_parts_test {
namespace {

using Eigen::Vector3d;

/// What an accessor of floats shows, by the rules of glTF 2.0, section 3.6.
template <class T>
std::vector<T> ValuesOf(const tinygltf::Model& model, int index) {
  const tinygltf::Accessor& accessor = model.accessors.at(static_cast<std::size_t>(index));
  const tinygltf::BufferView& view =
      model.bufferViews.at(static_cast<std::size_t>(accessor.bufferView));
  EXPECT_EQ(tinygltf::GetComponentSizeInBytes(static_cast<std::uint32_t>(accessor.componentType)),
            static_cast<int>(sizeof(T)));
  std::vector<T> values(accessor.count * static_cast<std::size_t>(tinygltf::GetNumComponentsInType(
                                             static_cast<std::uint32_t>(accessor.type))));
  EXPECT_EQ(view.byteLength, values.size() * sizeof(T));
  EXPECT_EQ((view.byteOffset + accessor.byteOffset) % 4, 0u) << "not aligned";
  EXPECT_LE(view.byteOffset + view.byteLength, model.buffers.at(0).data.size());
  std::memcpy(values.data(), model.buffers[0].data.data() + view.byteOffset + accessor.byteOffset,
              view.byteLength);
  return values;
}

TEST(GltfParts, AccessorsShowWhatWasAdded) {
  tinygltf::Model model = NewGltf("scene");
  const std::vector<std::uint8_t> colours = {1, 2, 3, 4, 5, 6};
  const std::vector<float> floats = {0.5f, -1, 2};
  const std::vector<std::uint16_t> indices = {0, 65535, 2};
  const int bytes = AddBytes(&model, colours, TINYGLTF_TYPE_VEC3);
  const int numbers = AddFloats(&model, floats, TINYGLTF_TYPE_VEC3);
  const int triangle = AddIndices(&model, indices);
  EXPECT_EQ(ValuesOf<std::uint8_t>(model, bytes), colours);
  EXPECT_EQ(ValuesOf<float>(model, numbers), floats);
  EXPECT_EQ(ValuesOf<std::uint16_t>(model, triangle), indices);
  const auto& accessors = model.accessors;
  EXPECT_EQ(accessors[0].count, 2u);
  EXPECT_TRUE(accessors[0].normalized) << "colours are shares of 255";
  EXPECT_FALSE(accessors[1].normalized || accessors[2].normalized);
  EXPECT_EQ(model.bufferViews[2].target, TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER);
}

TEST(GltfParts, PositionsHaveTheirBounds) {
  tinygltf::Model model = NewGltf("scene");
  const int index = AddPositions(&model, {1, -2, 3, -4, 5, 3, 0, 0, 9});
  const tinygltf::Accessor& accessor = model.accessors.at(static_cast<std::size_t>(index));
  EXPECT_EQ(accessor.minValues, (std::vector<double>{-4, -2, 3}));
  EXPECT_EQ(accessor.maxValues, (std::vector<double>{1, 5, 9}));
}

/// A node's matrix: translation times rotation, of a quaternion (x, y, z, w).
Pose PoseOf(const tinygltf::Node& node) {
  const std::vector<double>& q = node.rotation;
  Pose pose = Pose::Identity();
  pose.linear() = Eigen::Quaterniond(q.at(3), q.at(0), q.at(1), q.at(2)).toRotationMatrix();
  pose.translation() =
      Vector3d(node.translation.at(0), node.translation.at(1), node.translation.at(2));
  return pose;
}

TEST(GltfParts, SidesLieOnTheirBoxesAndFaceOutwards) {
  Box tilted = Box::FromMinMax("tilted", {-0.3, -0.2, -0.1}, {0.3, 0.2, 0.1});
  tilted.structure_from_box.linear() = RotationExp({0.3, -1.2, 0.7});
  tilted.structure_from_box.translation() = Vector3d(2, 1, -1);
  const Structure structure =
      Structure::FromBoxes("two", {Box::FromMinMax("plain", {0, 0, 0}, {0.4, 0.5, 0.6}), tilted});
  tinygltf::Model model = NewGltf("scene");
  const std::vector<int> nodes = AddBoxes(&model, structure);
  ASSERT_EQ(nodes.size(), 2u);
  std::size_t sides = 0;
  for (std::size_t b = 0; b < nodes.size(); ++b) {
    const tinygltf::Node& node = model.nodes.at(static_cast<std::size_t>(nodes[b]));
    const Pose pose = PoseOf(node);
    EXPECT_EQ(node.name, structure.boxes()[b].name);
    for (const auto& primitive : model.meshes.at(static_cast<std::size_t>(node.mesh)).primitives) {
      const auto positions = ValuesOf<float>(model, primitive.attributes.at("POSITION"));
      const auto normals = ValuesOf<float>(model, primitive.attributes.at("NORMAL"));
      ASSERT_EQ(positions.size(), 12u);
      std::vector<Vector3d> corners;
      for (std::size_t i = 0; i < 12; i += 3)
        corners.push_back(pose * Vector3d(positions[i], positions[i + 1], positions[i + 2]));
      const auto label = static_cast<std::uint8_t>(primitive.extras.Get("label").GetNumberAsInt());
      const std::string face = primitive.extras.Get("side").Get<std::string>();
      for (const Side& side : structure.sides()) {
        if (side.box != static_cast<int>(b) || FaceName(side.face) != face) continue;
        ++sides;
        EXPECT_EQ(side.label, label);
        EXPECT_LT(((corners[0] + corners[1] + corners[2] + corners[3]) / 4 - side.centre).norm(),
                  1e-6);
        EXPECT_NEAR((corners[1] - corners[0]).norm() * (corners[3] - corners[0]).norm(),
                    4 * side.half_u * side.half_v, 1e-6);
        const auto triangle = ValuesOf<std::uint16_t>(model, primitive.indices);
        ASSERT_EQ(triangle.size(), 6u);
        for (const std::size_t t : {0, 3}) {  // counter-clockwise, seen from outside
          const Vector3d a = corners.at(triangle[t]),
                         normal = (corners.at(triangle[t + 1]) - a)
                                      .cross(corners.at(triangle[t + 2]) - a)
                                      .normalized();
          EXPECT_LT((normal - side.normal).norm(), 1e-5) << side.name;
        }
        EXPECT_LT(
            (pose.linear() * Vector3d(normals[0], normals[1], normals[2]) - side.normal).norm(),
            1e-6);
      }
    }
  }
  EXPECT_EQ(sides, 12u);
}

TEST(GltfParts, WritesABinaryFile) {
  const TempFolder folder;
  tinygltf::Model model = NewGltf("scene");
  AddFloats(&model, {1, 2, 3}, TINYGLTF_TYPE_VEC3);
  WriteGlb(folder / "a.glb", model);
  const std::string bytes = ReadFile(folder / "a.glb");
  ASSERT_GT(bytes.size(), 20u);
  std::uint32_t head[3];
  std::memcpy(head, bytes.data(), sizeof(head));
  EXPECT_EQ(head[0], 0x46546C67u);  // "glTF"
  EXPECT_EQ(head[1], 2u);
  EXPECT_EQ(head[2], bytes.size());
}

}  // namespace
}  // namespace volalign::gltf_parts_test

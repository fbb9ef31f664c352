#include "core/formats/gltf_parts.h"

#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/random.h"
#include "core/formats/structure_gltf.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/read_file.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/formats/glb_chunks.h"
#include "tests/core/geometry/mesh_shapes.h"

namespace volalign::gltf_parts_test {
namespace {

using Eigen::Vector3d;
using nlohmann::json;

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

struct Glb : GlbChunks {
  using GlbChunks::GlbChunks;
  template <class T>
  T At(const json& accessor, std::size_t element, std::size_t component,
       std::size_t components) const {
    const json& view = document.at("bufferViews").at(accessor.at("bufferView").get<std::size_t>());
    T value;
    std::memcpy(&value,
                binary.data() + view.value("byteOffset", 0u) + accessor.value("byteOffset", 0u) +
                    (element * components + component) * sizeof(T),
                sizeof(T));
    return value;
  }
};

/// Boxes that are thrown together.
Structure RandomStructure() {
  RandomStream random(8, 3, "boxes");
  std::vector<Box> boxes;
  for (const char* name : {"box 0", "box 1", "box 2"}) {
    Box& box = boxes.emplace_back();
    box.name = name;
    box.size = {random.Uniform(0.1, 0.6), random.Uniform(0.1, 0.6), random.Uniform(0.1, 0.6)};
    box.structure_from_box.translation() =
        Vector3d{random.Uniform(-1, 1), random.Uniform(0, 2), random.Uniform(-1, 1)};
    box.structure_from_box.linear() =
        RotationExp(Vector3d{random.Normal(), random.Normal(), random.Normal()});
  }
  return Structure::FromBoxes("structure", boxes);
}

// One named node a box, one primitive a side, extras with side, label and
// keypoints.
TEST(WriteStructureGlb, TheFileIsWhatTheDesignSays) {
  const TempFolder folder;
  for (const Structure& structure : {ReadStructure("configs/structure.yaml"), RandomStructure()}) {
    WriteStructureGlb(folder / "a.glb", structure);
    const Glb glb(ReadFile(folder / "a.glb"));
    const json& root = glb.document;
    EXPECT_EQ(root.at("asset").at("version"), "2.0");
    ASSERT_EQ(root.at("buffers").size(), 1u);
    EXPECT_LE(root.at("buffers")[0].at("byteLength").get<std::size_t>(), glb.binary.size());
    EXPECT_FALSE(root.at("buffers")[0].contains("uri"));
    const json& scene = root.at("scenes").at(root.at("scene").get<std::size_t>());
    ASSERT_EQ(scene.at("nodes").size(), structure.boxes().size());
    std::size_t i = 0;
    for (const json& node_index : scene.at("nodes")) {
      const json& node = root.at("nodes").at(node_index.get<std::size_t>());
      const Box& box = structure.boxes().at(i);
      EXPECT_EQ(node.at("name"), box.name);
      // The node's transform by hand: v' = v + 2 w (q x v) + 2 q x (q x v), plus the translation.
      const auto q = node.at("rotation").get<std::vector<double>>();
      const auto t = node.at("translation").get<std::vector<double>>();
      const Vector3d qv(q[0], q[1], q[2]), translation(t[0], t[1], t[2]);
      const auto transform = [&](const Vector3d& p) {
        return Vector3d(p + 2 * q[3] * qv.cross(p) + 2 * qv.cross(qv.cross(p)) + translation);
      };
      const json& primitives =
          root.at("meshes").at(node.at("mesh").get<std::size_t>()).at("primitives");
      ASSERT_EQ(primitives.size(), 6u);
      for (std::size_t f = 0; f < 6; ++f) {
        const Side& side = structure.sides().at(6 * i + f);
        const json& extras = primitives[f].at("extras");
        EXPECT_EQ(box.name + "/" + extras.at("side").get<std::string>(), side.name);
        EXPECT_EQ(extras.at("label").get<int>(), side.label);
        for (int k = 0; k < 3; ++k) {
          EXPECT_NEAR(extras.at("centre").at(static_cast<std::size_t>(k)).get<double>(),
                      side.centre[k], 1e-9);
          EXPECT_NEAR(extras.at("exposed_centroid").at(static_cast<std::size_t>(k)).get<double>(),
                      side.exposed_centroid[k], 1e-9);
        }
        const json& position =
            root.at("accessors")
                .at(primitives[f].at("attributes").at("POSITION").get<std::size_t>());
        const json& index = root.at("accessors").at(primitives[f].at("indices").get<std::size_t>());
        EXPECT_EQ(position.at("componentType"), 5126);
        EXPECT_EQ(position.at("type"), "VEC3");
        ASSERT_EQ(position.at("count"), 4);
        EXPECT_EQ(index.at("componentType"), 5123);
        ASSERT_EQ(index.at("count"), 6);
        // Triangles in the structure frame: area, winding (counter-clockwise from outside) and
        // place.
        double area = 0;
        for (std::size_t triangle = 0; triangle < 2; ++triangle) {
          Vector3d p[3];
          for (std::size_t c = 0; c < 3; ++c) {
            const auto vertex = glb.At<std::uint16_t>(index, 3 * triangle + c, 0, 1);
            ASSERT_LT(vertex, 4);
            Vector3d local;
            for (std::size_t k = 0; k < 3; ++k) {
              local[static_cast<int>(k)] = glb.At<float>(position, vertex, k, 3);
              EXPECT_LE(local[static_cast<int>(k)], position.at("max").at(k).get<double>() + 1e-9);
              EXPECT_GE(local[static_cast<int>(k)], position.at("min").at(k).get<double>() - 1e-9);
            }
            p[c] = transform(local);
            EXPECT_LT((side.ClosestPoint(p[c]) - p[c]).norm(), 1e-6);
          }
          const Vector3d cross = (p[1] - p[0]).cross(p[2] - p[0]);
          area += cross.norm() / 2;
          EXPECT_GT(cross.normalized().dot(side.normal), 1 - 1e-6) << side.name;
        }
        const json& normal =
            root.at("accessors").at(primitives[f].at("attributes").at("NORMAL").get<std::size_t>());
        for (std::size_t vertex = 0; vertex < 4; ++vertex) {
          const Vector3d n(glb.At<float>(normal, vertex, 0, 3), glb.At<float>(normal, vertex, 1, 3),
                           glb.At<float>(normal, vertex, 2, 3));
          EXPECT_LT((transform(n) - translation - side.normal).norm(), 1e-6);
        }
        EXPECT_NEAR(area, 4 * side.half_u * side.half_v, 1e-6) << side.name;
      }
      ++i;
    }
  }
  ExpectError<IoError>(
      [] { WriteStructureGlb("/proc/none/a.glb", ReadStructure("configs/structure.yaml")); },
      {"/proc/none"});
}

// Another reader, Assimp, finds the same parts and sides.
TEST(WriteStructureGlb, AMeshReadsBack) {
  const TempFolder folder;
  for (const mesh_shapes::Shape& shape : mesh_shapes::TenShapes()) {
    const Structure mesh = mesh_shapes::StructureOf(shape);
    WriteStructureGlb(folder / "a.glb", mesh);
    const Structure read = ReadStructure(folder / "a.glb");
    ASSERT_EQ(read.boxes().size(), mesh.boxes().size()) << shape.name;
    EXPECT_EQ(read.num_classes(), mesh.num_classes()) << shape.name;
    double area = 0, read_area = 0;
    for (const Side& side : mesh.sides()) area += side.Area();
    for (const Side& side : read.sides()) read_area += side.Area();
    EXPECT_NEAR(read_area, area, 1e-4) << shape.name;
    for (std::size_t b = 0; b < read.boxes().size(); ++b) {
      EXPECT_EQ(read.boxes()[b].name, mesh.boxes()[b].name);
      EXPECT_LT((read.boxes()[b].size - mesh.boxes()[b].size).norm(), 1e-6);
      EXPECT_LT((read.boxes()[b].structure_from_box.translation() -
                 mesh.boxes()[b].structure_from_box.translation())
                    .norm(),
                1e-6);
    }
    const json document = Glb(ReadFile(folder / "a.glb")).document;
    for (const json& primitive : document.at("meshes").at(0).at("primitives")) {
      const std::string name =
          mesh.boxes()[0].name + "/" + primitive.at("extras").at("side").get<std::string>();
      for (const Side& side : mesh.sides()) {
        if (side.name != name) continue;
        EXPECT_EQ(primitive.at("extras").at("label"), side.label);
      }
    }
  }
}

}  // namespace
}  // namespace volalign::gltf_parts_test

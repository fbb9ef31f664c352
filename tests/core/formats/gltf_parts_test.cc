#include "core/formats/gltf_parts.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "core/formats/structure_gltf.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/formats/glb_chunks.h"
#include "tests/core/geometry/mesh_shapes.h"

namespace volalign::gltf_parts_test {
namespace {

using Eigen::Vector3d;
using nlohmann::json;

TEST(GltfParts, PositionsHaveTheirBounds) {
  tinygltf::Model model = NewGltf("scene");
  const int index = AddPositions(&model, {1, -2, 3, -4, 5, 3, 0, 0, 9});
  const tinygltf::Accessor& accessor = model.accessors.at(static_cast<std::size_t>(index));
  EXPECT_EQ(accessor.minValues, (std::vector<double>{-4, -2, 3}));
  EXPECT_EQ(accessor.maxValues, (std::vector<double>{1, 5, 9}));
}

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

// One named node a box, one primitive a side, extras with side, label and keypoints.
TEST(WriteStructureGlb, TheFileIsWhatTheDesignSays) {
  const TempFolder folder;
  for (const Structure& structure : {ReadStructure("configs/structure.yaml"), RandomStructure()}) {
    WriteStructureGlb(folder / "a.glb", structure);
    const GlbChunks glb(ReadFile(folder / "a.glb"));
    const json& root = glb.document;
    const json& nodes = glb.Item("scenes", root.at("scene")).at("nodes");
    ASSERT_EQ(nodes.size(), structure.boxes().size());
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      const json& node = glb.Item("nodes", nodes[i]);
      const Box& box = structure.boxes().at(i);
      EXPECT_EQ(node.at("name"), box.name);
      const auto q = node.at("rotation").get<std::array<double, 4>>();
      const auto t = node.at("translation").get<std::array<double, 3>>();
      const Pose pose =
          Eigen::Translation3d(t[0], t[1], t[2]) * Pose(Eigen::Quaterniond(q[3], q[0], q[1], q[2]));
      const json& primitives = glb.Item("meshes", node.at("mesh")).at("primitives");
      ASSERT_EQ(primitives.size(), 6u);
      for (std::size_t f = 0; f < 6; ++f) {
        const Side& side = structure.sides().at(6 * i + f);
        const json& extras = primitives[f].at("extras");
        EXPECT_EQ(box.name + "/" + extras.at("side").get<std::string>(), side.name);
        EXPECT_EQ(extras.at("label").get<int>(), side.label);
        for (int k = 0; k < 3; ++k) {
          EXPECT_NEAR(extras.at("centre").at(k).get<double>(), side.centre[k], 1e-9);
          EXPECT_NEAR(extras.at("exposed_centroid").at(k).get<double>(), side.exposed_centroid[k],
                      1e-9);
        }
        const json& attributes = primitives[f].at("attributes");
        EXPECT_TRUE(glb.Item("accessors", attributes.at("POSITION")).contains("max"));
        const auto corners = glb.Values<float>(attributes.at("POSITION"), 3, 5126),
                   normals = glb.Values<float>(attributes.at("NORMAL"), 3, 5126);
        const auto indices = glb.Values<std::uint16_t>(primitives[f].at("indices"), 1, 5123);
        ASSERT_EQ(corners.size(), 12u);
        ASSERT_EQ(normals.size(), 12u);
        ASSERT_EQ(indices.size(), 6u);
        const auto vector = [](const std::vector<float>& numbers, std::size_t vertex) {
          return Vector3d(Eigen::Vector3f(&numbers[3 * vertex]).cast<double>());
        };
        // Triangles in the structure frame: area, winding (counter-clockwise from outside) and
        // place.
        double area = 0;
        for (std::size_t triangle = 0; triangle < 6; triangle += 3) {
          Vector3d p[3];
          for (std::size_t c = 0; c < 3; ++c) {
            const std::uint16_t vertex = indices[triangle + c];
            ASSERT_LT(vertex, 4);
            p[c] = pose * vector(corners, vertex);
            EXPECT_LT((side.ClosestPoint(p[c]) - p[c]).norm(), 1e-6);
            EXPECT_LT((pose.linear() * vector(normals, vertex) - side.normal).norm(), 1e-6);
          }
          const Vector3d cross = (p[1] - p[0]).cross(p[2] - p[0]);
          area += cross.norm() / 2;
          EXPECT_GT(cross.normalized().dot(side.normal), 1 - 1e-6) << side.name;
        }
        EXPECT_NEAR(area, 4 * side.half_u * side.half_v, 1e-6) << side.name;
      }
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
    const json document = GlbChunks(ReadFile(folder / "a.glb")).document;
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

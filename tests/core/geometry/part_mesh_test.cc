#include "core/geometry/part_mesh.h"

#include <assimp/scene.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <assimp/Exporter.hpp>
#include <assimp/Importer.hpp>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/frame_errors.h"
#include "core/geometry/mesh_file.h"
#include "core/geometry/stack_faults.h"
#include "core/geometry/structure.h"
#include "core/geometry/visibility.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/geometry/mesh_shapes.h"

namespace volalign::part_mesh_test {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

using namespace mesh_shapes;

Solid Box3(double width, double height, double depth) {
  return Cuboid({-width / 2, 0, -depth / 2}, {width / 2, height, depth / 2});
}

/// 60 x 40 x 60 cm less a corner of 30 x 40 x 30 cm.
Solid Corner() {
  return Extruded(1, {{0, 0}, {0.6, 0}, {0.6, 0.3}, {0.3, 0.3}, {0.3, 0.6}, {0, 0.6}}, 0, 0.4);
}

Solid Drum(int segments) { return Cylinder({0, 0, 0}, 0.3, 0.5, segments); }

bool HasParts(const std::string& ending) {
  return ending == "glb" || ending == "gltf" || ending == "obj";
}

Box PartOf(const Solid& solid, const std::string& name = "part") {
  return Box::FromMesh(name, PartMesh::Make(solid.vertices, solid.triangles));
}

/// NAME.glb, .gltf with NAME.bin, .obj, .ply or .stl; "ascii.stl" is a text. Formats without parts
/// have z up.
std::filesystem::path WriteShape(const TempFolder& folder, Shape shape, const std::string& ending) {
  const std::map<std::string, const char*> formats = {{"glb", "glb2"}, {"gltf", "gltf2"},
                                                      {"obj", "obj"},  {"ply", "ply"},
                                                      {"stl", "stlb"}, {"ascii.stl", "stl"}};
  if (!HasParts(ending)) {
    for (Solid& part : shape.parts)
      for (Vector3d& p : part.vertices) p = {p.x(), -p.z(), p.y()};
  }
  const std::filesystem::path obj = WriteObj(folder, shape);
  if (ending == "obj") return obj;
  Assimp::Importer importer;
  const std::filesystem::path path = folder / (shape.name + "." + ending);
  EXPECT_EQ(Assimp::Exporter().Export(importer.ReadFile(obj, 0), formats.at(ending), path),
            aiReturn_SUCCESS);
  return path;
}

Structure Of(const Solid& solid, const std::string& name = "part") {
  return Structure::FromBoxes("test", {PartOf(solid, name)});
}

// Rays, distances and insides of boxes are told by their extents, those of meshes by triangles.
TEST(PartMesh, CuboidsAreBoxes) {
  int hits = 0, inside = 0;
  for (std::uint64_t index = 0; index < 8; ++index) {
    const Structure mesh = RandomCuboids(index, true), box = RandomCuboids(index);
    ASSERT_EQ(mesh.num_classes(), box.num_classes());
    EXPECT_EQ(mesh.sides().size(), 30U);
    EXPECT_NEAR(mesh.FloorHeight(), box.FloorHeight(), 1e-12);
    RandomStream random(1, index, "cuboid");
    for (int i = 0; i < 2000; ++i) {
      const auto draw = [&](double reach) {
        return Vector3d(random.Uniform(-reach, reach), random.Uniform(-reach, reach),
                        random.Uniform(-reach, reach));
      };
      const Vector3d from = draw(2.5), towards = draw(0.8) - from, p = draw(1);
      const RayHit a = CastRay(mesh, from, towards), b = CastRay(box, from, towards);
      ASSERT_EQ(a.side < 0, b.side < 0);
      EXPECT_EQ(a.t < 1e9, a.side >= 0);
      const auto side = [](const Structure& of, int number) {
        return of.sides()[static_cast<std::size_t>(number)];
      };
      if (a.side >= 0) {
        ++hits;
        EXPECT_NEAR(a.t, b.t, 1e-9);
        EXPECT_LT((side(mesh, a.side).normal - side(box, b.side).normal).norm(), 1e-9);
        EXPECT_EQ(side(mesh, a.side).box, side(box, b.side).box);
      }
      const SurfaceDistance of_mesh = DistanceToSurface(mesh, p),
                            of_box = DistanceToSurface(box, p);
      EXPECT_NEAR(of_mesh.distance, of_box.distance, 1e-9);
      for (const auto& [structure, distance] : {std::pair(&mesh, of_mesh), {&box, of_box}}) {
        const Vector3d closest = side(*structure, distance.side).ClosestPoint(p);
        EXPECT_NEAR((closest - p).norm(), distance.distance, 1e-9);
      }
      EXPECT_EQ(mesh.Contains(p), box.Contains(p));
      inside += box.Contains(p);
    }
  }
  EXPECT_GT(hits, 3000);
  EXPECT_GT(inside, 100);
}

TEST(PartMesh, FacetsHaveOutlinesBordersAndAreas) {
  const Structure corner = Of(Corner());
  // A top of 27 dm2 in L form, six upright sides, and the bottom without label.
  ASSERT_EQ(corner.num_classes(), 8);
  const Side& top = corner.SideOfLabel(1);
  EXPECT_NEAR(top.Area(), 0.27, 1e-9);
  EXPECT_NEAR(top.exposed_area, 0.27, 1e-9);
  EXPECT_NEAR(top.normal.y(), 1, 1e-12);
  EXPECT_EQ(top.CountBorders(), 6);
  EXPECT_LT((top.Middle() - Vector3d(0.25, 0.4, 0.25)).norm(), 1e-9);
  // In the notch: beyond by 10 cm, drawn to its border.
  const Vector3d notch(0.4, 0.4, 0.45);
  EXPECT_NEAR(top.Beyond(notch), 0.1, 1e-9);
  EXPECT_LT((top.ClosestPoint(notch) - Vector3d(0.3, 0.4, 0.45)).norm(), 1e-9);
  EXPECT_NEAR(top.Beyond(Vector3d(0.1, 0.4, 0.2)), -0.1, 1e-9);
  double perimeter = 0;
  for (int i = 0; i < top.CountBorders(); ++i) {
    const Border border = top.BorderAt(i);
    perimeter += border.length;
    EXPECT_NEAR(border.outward.norm(), 1, 1e-12);
    EXPECT_NEAR(border.outward.dot(border.middle - top.centre), border.extent, 1e-12);
    EXPECT_GT(top.Beyond(border.middle + 0.01 * border.outward), 0.009);
    EXPECT_LT(top.Beyond(border.middle - 0.01 * border.outward), -0.009);
  }
  EXPECT_NEAR(perimeter, 2.4, 1e-9);
}

TEST(PartMesh, CurvedSmallAndLowerSurfaceHasNoLabel) {
  EXPECT_EQ(Of(Drum(8)).num_classes(), 10) << "eight sides of 45 deg, and the top";
  EXPECT_EQ(Of(Drum(48)).num_classes(), 2) << "the top";
  EXPECT_EQ(Of(Box3(0.02, 0.6, 0.3)).num_classes(), 3) << "a board's narrow sides have none";
}

TEST(PartMesh, PartsCoverEachOther) {
  const Solid low = Box3(0.6, 0.3, 0.4);
  Solid high = Box3(0.3, 0.2, 0.4);
  for (Vector3d& p : high.vertices) p += Vector3d(0.15, 0.3, 0);
  const Structure both = Structure::FromBoxes("test", {PartOf(low, "low"), PartOf(high, "high")});
  const Structure joined = Of(Joined("all", {low, high}));
  EXPECT_EQ(joined.num_classes(), both.num_classes() - 1) << "two sides in one plane are one";
  EXPECT_TRUE(joined.Contains({0.15, 0.3 + kTouching, 0})) << "beyond where the solids touch";
  EXPECT_NEAR(joined.SideOfLabel(1).exposed_area, 0.12, 1e-3) << joined.SideOfLabel(1).name;
  for (const Side& side : both.sides()) {
    if (side.box != 0 || side.normal.y() < 0.9) continue;
    EXPECT_NEAR(side.exposed_area, 0.12, 1e-3);
    EXPECT_LT((side.exposed_centroid - Vector3d(-0.15, 0.3, 0)).norm(), 5e-3);
  }
  // Moved and scaled: rays find it where it is.
  std::vector<Pose> offsets(2, Pose::Identity());
  offsets[1].translation().x() = -0.1;
  const Structure moved = both.Displaced(offsets, 1.1);
  const RayHit hit = CastRay(moved, {0.05, 2, 0}, {0, -1, 0});
  EXPECT_NEAR(2 - hit.t, 0.4 + 1.1 * 0.1, 1e-6);
  EXPECT_NEAR(DistanceToSurface(moved, {0.05, 1, 0}).distance, 1 - 0.51, 1e-6);
}

// As of two boxes, one on the other.
TEST(PartMesh, ConcaveCornersOfOneMeshAreSeams) {
  const Vector3d low(-0.3, 0, -0.2), top(0.3, 0.3, 0.2), foot(0, 0.3, -0.2), high(0.3, 0.5, 0.2);
  const Structure mesh = Of(Joined("all", {Cuboid(low, top), Cuboid(foot, high)}));
  const Structure boxes = Structure::FromBoxes(
      "test", {Box::FromMinMax("low", low, top), Box::FromMinMax("high", foot, high)});
  for (const Side& side : boxes.sides()) {
    if (side.label == 0) continue;
    const Vector3d q = side.exposed_centroid;
    const Side& same = mesh.sides()[static_cast<std::size_t>(DistanceToSurface(mesh, q).side)];
    ASSERT_GT(same.normal.dot(side.normal), 0.999) << side.name;
    EXPECT_NEAR(SeamDistance(mesh, same, q), SeamDistance(boxes, side, q), 1e-9) << side.name;
  }
}

TEST(PartMesh, SaysWhatIsNoTarget) {
  Solid open = Box3(0.5, 0.3, 0.4);
  open.triangles.pop_back();
  ExpectError<DataError>([&] { Of(open); }, {"the surface is open", "3 of 18 edges"});
  const Solid cuboid = Box3(0.5, 0.3, 0.4);
  Solid twice = Joined("twice", {cuboid, cuboid});
  EXPECT_EQ(Of(twice).sides().size(), 6U) << "once";
  Solid reversed = Cuboid({1, 0, 0}, {1.5, 0.9, 0.5});
  for (PartMesh::Triangle& t : reversed.triangles) std::swap(t[0], t[1]);
  const Structure both = Of(Joined("both", {cuboid, reversed}));
  EXPECT_TRUE(both.Contains({0, 0.1, 0}) && both.Contains({1.2, 0.1, 0.1})) << "turned";
  Solid cavity = Cuboid({-0.2, 0.05, -0.15}, {0.2, 0.25, 0.15});
  for (PartMesh::Triangle& t : cavity.triangles) std::swap(t[0], t[1]);
  const Structure hollow = Of(Joined("hollow", {cuboid, cavity}));
  EXPECT_FALSE(hollow.Contains({0, 0.1, 0}));
  EXPECT_TRUE(hollow.Contains({0, 0.02, 0}));
  Solid sheet = Box3(0.5, 0.3, 0.4);
  for (Vector3d& p : sheet.vertices) p.y() = 0;
  ExpectError<DataError>([&] { Of(sheet); }, {"encloses no volume"});
  Solid far = Box3(0.5, 0.3, 0.4);
  far.vertices[0].x() = 1e300;
  ExpectError<DataError>([&] { Of(far); }, {"more than 10000 m away"});
  Solid inside_out = Box3(0.5, 0.3, 0.4);
  for (PartMesh::Triangle& t : inside_out.triangles) std::swap(t[0], t[1]);
  EXPECT_EQ(Of(inside_out).num_classes(), 6) << "turned";
  inside_out.triangles.push_back({0, 1, 99});
  ExpectError<DataError>([&] { Of(inside_out); }, {"vertex 99 of 8"});
  const std::vector<StackFault> faults = FindStackFaults(Of(Drum(48)));
  ASSERT_FALSE(faults.empty());
  EXPECT_TRUE(faults.front().impossible);
  EXPECT_NE(faults.front().text.find("fewer than three directions"), std::string::npos);
}

TEST(MeshFile, UnitsAndAxes) {
  const TempFolder folder;
  Shape shape{"corner", {Corner()}};
  for (Vector3d& p : shape.parts[0].vertices) p = 1e3 * Vector3d(p.x(), -p.z(), p.y());
  const std::filesystem::path path = WriteObj(folder, shape);  // millimetres, z up
  ExpectError<ConfigError>([&] { ReadStructure(path); }, {"600 m long", "--mesh-scale 0.001"});
  const std::vector<Box> parts = ReadMeshParts(path, {1e-3, MeshUp::kZ});
  ASSERT_EQ(parts.size(), 1U);
  EXPECT_LT((parts[0].size - Vector3d(0.6, 0.4, 0.6)).norm(), 1e-6);
  folder.Write("corner.yaml", "meshes: [{file: corner.obj, scale: 0.001, up: z}]\n");
  const Structure read = ReadStructure(folder.path() / "corner.yaml");
  EXPECT_EQ(read.num_classes(), 8);
  EXPECT_LT((read.SideOfLabel(1).Middle() - Vector3d(0.25, 0.4, 0.25)).norm(), 1e-6);
  ExpectError<DataError>([&] { ReadMeshParts(folder.path() / "corner.yaml"); },
                         {"a mesh is a .glb"});
}

TEST(MeshFile, OpensNothingElseThatAFileNames) {
  const TempFolder folder;
  const std::filesystem::path path = WriteShape(folder, Ell(), "gltf");
  EXPECT_EQ(ReadMeshParts(path).size(), 1U);
  std::string document = ReadFile(path);
  document.insert(document.find("ell.bin"), "../");
  std::filesystem::create_directory(folder.path() / "other");
  const auto elsewhere = folder.Write("other/ell.gltf", document);
  ExpectError<DataError>([&] { ReadMeshParts(elsewhere); }, {"cannot be read as .gltf"});
}

TEST(MeshFile, RefusesWhatWouldTakeTheMachine) {
  const TempFolder folder;
  const auto refuses = [&](const std::string& name, const std::string& bytes, const char* why) {
    ExpectError<DataError>([&] { ReadMeshParts(folder.Write(name, bytes)); }, {why});
  };
  refuses("deep.gltf", R"({"nodes":)" + std::string(100000, '['), "nested deeper than 64");
  std::string chain, graph;
  for (int i = 0; i < 100; ++i) {
    chain += fmt::format(R"({{"children":[{}]}},)", i + 1);
    graph += fmt::format(R"({{"children":[{0},{0}]}},)", i + 1);
  }
  refuses("chain.gltf", R"({"nodes":[)" + chain + "{}]}", "nested deeper than 64");
  refuses("graph.gltf", R"({"nodes":[)" + graph + "{}]}", "the child of two nodes");
  refuses("ring.gltf", R"({"nodes":[{"children":[0]}]})", "nested deeper than 64");
  // Assimp takes the first of two keys, and reads bytes that are not UTF-8 and glTF 1.
  refuses("twice.gltf", R"({"nodes":[{"children":[0]}],"nodes":[{}]})", "\"nodes\" stands twice");
  refuses("latin1.gltf", "{\"nodes\":[{\"children\":[0],\"name\":\"\xff\"}]}", "JSON has a fault");
  refuses("one.gltf", R"({"nodes":{"a":{"children":["a"]}}})", "glTF 2 is read");
  refuses("roots.gltf", R"({"scenes":[{"nodes":[0,0]}],"nodes":[{}]})", "a node twice");
  std::string primitives;
  for (int i = 0; i < 100; ++i) primitives += R"({"attributes":{"POSITION":0}},)";
  refuses("shared.gltf",
          R"({"accessors":[{"count":1000000}],"meshes":[{"primitives":[)" + primitives + "{}]}]}",
          "more than 5e+07 vertices");
  refuses("lies.ply", "ply\nformat ascii 1.0\nelement vertex 800000000\nend_header\n", "cut off");
  refuses("passwd", "root", "a mesh is a .glb");
}

// Rounding of equal areas, which differs between the files, gives no other order of the labels.
TEST(MeshFile, EveryFormatAndTheCopyAreTheSameStructure) {
  const TempFolder folder;
  for (const Shape& shape : TenShapes()) {
    const Structure made = StructureOf(shape);
    EXPECT_TRUE(FindStackFaults(made).empty() || !FindStackFaults(made).front().impossible);
    for (const std::string ending : {"glb", "gltf", "obj", "ply", "stl", "ascii.stl"}) {
      SCOPED_TRACE(shape.name + "." + ending);
      const Structure read = ReadStructure(WriteShape(folder, shape, ending));
      folder.Write("copy.yaml", StructureYaml(read));
      const Structure copy = ReadStructure(folder / "copy.yaml");
      EXPECT_EQ(copy.Hash(), read.Hash());
      EXPECT_EQ(copy.SideNames(), read.SideNames());
      EXPECT_EQ(read.boxes().size(), HasParts(ending) ? made.boxes().size() : 1);
      double area = 0;
      for (int label = 1; label < made.num_classes(); ++label)
        area += made.SideOfLabel(label).exposed_area;
      for (int label = 1; label < read.num_classes(); ++label) {
        const Side& side = read.SideOfLabel(label);
        area -= side.exposed_area;
        EXPECT_LT((copy.SideOfLabel(label).centre - side.centre).norm(), 1e-6);
        if (read.boxes().size() != made.boxes().size()) continue;
        EXPECT_LT((made.SideOfLabel(label).centre - side.centre).norm(), 1e-6) << label;
      }
      EXPECT_NEAR(area, 0, 0.05);
      RandomStream random(1, 0, "formats");
      for (int i = 0; i < 50; ++i) {
        const Vector3d from(random.Uniform(1, 2), random.Uniform(-1, 1), random.Uniform(1, 2));
        const Vector3d towards = Vector3d(random.Uniform(-0.2, 0.2), random.Uniform(-0.2, 0.2),
                                          random.Uniform(-0.2, 0.2)) -
                                 from;
        const RayHit a = CastRay(made, from, towards), b = CastRay(read, from, towards);
        if (a.side >= 0 && b.side >= 0) {
          EXPECT_NEAR(a.t, b.t, 2e-3);
        }
      }
    }
  }
}

}  // namespace
}  // namespace volalign::part_mesh_test

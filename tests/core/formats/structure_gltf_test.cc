#include "core/formats/structure_gltf.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/random.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::structure_gltf_test {
namespace {

using Eigen::Vector3d;
using nlohmann::json;

Structure PaperStructure() { return ReadStructureYaml("configs/structure.yaml"); }

Structure RandomStructure(std::uint64_t index, int count) {
  RandomStream random(8, index, "boxes");
  std::vector<Box> boxes;
  std::vector<std::string> order;
  for (int b = 0; b < count; ++b) {
    Box box;
    box.name = "box " + std::to_string(b);
    box.size = {random.Uniform(0.1, 0.6), random.Uniform(0.1, 0.6), random.Uniform(0.1, 0.6)};
    box.structure_from_box.translation() =
        Vector3d{random.Uniform(-1, 1), random.Uniform(0, 2), random.Uniform(-1, 1)};
    // Half of the structures stand level, half are thrown together.
    const Vector3d turn{random.Normal(), random.Normal(), random.Normal()};
    box.structure_from_box.linear() = RotationExp(index % 2 ? turn : Vector3d(0, turn.y(), 0));
    boxes.push_back(box);
    for (const char* face : {"left", "up", "front", "right", "back"}) {
      order.insert(order.begin() + random.Below(static_cast<int>(order.size()) + 1),
                   box.name + "/" + face);
    }
  }
  return Structure::FromBoxes("structure " + std::to_string(index), boxes, order);
}

void ExpectEqual(const Structure& a, const Structure& b) {
  EXPECT_EQ(a.name(), b.name());
  EXPECT_EQ(a.num_classes(), b.num_classes());
  EXPECT_EQ(a.SideNames(), b.SideNames());
  ASSERT_EQ(a.boxes().size(), b.boxes().size());
  for (std::size_t i = 0; i < a.boxes().size(); ++i) {
    EXPECT_EQ(a.boxes()[i].name, b.boxes()[i].name);
    // Vertices are stored as float32.
    EXPECT_LT((a.boxes()[i].size - b.boxes()[i].size).norm(), 1e-6);
    EXPECT_LT((a.boxes()[i].structure_from_box.matrix() - b.boxes()[i].structure_from_box.matrix())
                  .norm(),
              1e-6);
  }
  for (std::size_t i = 0; i < a.sides().size(); ++i) {
    const Side &x = a.sides()[i], &y = b.sides()[i];
    EXPECT_EQ(x.name, y.name);
    EXPECT_EQ(x.label, y.label);
    EXPECT_LT((x.centre - y.centre).norm(), 1e-6);
    EXPECT_LT((x.normal - y.normal).norm(), 1e-6);
    EXPECT_NEAR(x.exposed_area, y.exposed_area, 1e-5);
    EXPECT_LT((x.exposed_centroid - y.exposed_centroid).norm(), 1e-4);
  }
}

/// The two chunks of a .glb, read by the format's own definition (glTF 2.0, section 4.4).
struct Glb {
  json content;
  std::string binary;

  static std::uint32_t Word(const std::string& bytes, std::size_t at) {
    std::uint32_t word = 0;
    for (int i = 3; i >= 0; --i)
      word = word << 8 | static_cast<unsigned char>(bytes.at(at + static_cast<std::size_t>(i)));
    return word;
  }
  static Glb Parse(const std::string& bytes) {
    Glb glb;
    EXPECT_EQ(bytes.substr(0, 4), "glTF");
    EXPECT_EQ(Word(bytes, 4), 2u);
    EXPECT_EQ(Word(bytes, 8), bytes.size());
    const std::uint32_t json_size = Word(bytes, 12);
    EXPECT_EQ(bytes.substr(16, 4), "JSON");
    EXPECT_EQ(json_size % 4, 0u);
    glb.content = json::parse(bytes.substr(20, json_size));
    const std::uint32_t binary_size = Word(bytes, 20 + json_size);
    EXPECT_EQ(bytes.substr(24 + json_size, 4), std::string("BIN\0", 4));
    EXPECT_EQ(binary_size % 4, 0u);
    EXPECT_EQ(28 + json_size + binary_size, bytes.size());
    glb.binary = bytes.substr(28 + json_size, binary_size);
    return glb;
  }
  std::string Bytes() const { return Bytes(content.dump()); }
  std::string Bytes(std::string text) const {
    while (text.size() % 4) text += ' ';
    const auto word = [](std::size_t x) {
      std::string bytes;
      for (int i = 0; i < 4; ++i) bytes.push_back(static_cast<char>(x >> (8 * i)));
      return bytes;
    };
    return "glTF" + word(2) + word(28 + text.size() + binary.size()) + word(text.size()) + "JSON" +
           text + word(binary.size()) + std::string("BIN\0", 4) + binary;
  }
  template <class T>
  T At(const json& accessor, std::size_t element, std::size_t component,
       std::size_t components) const {
    const json& view = content.at("bufferViews").at(accessor.at("bufferView").get<std::size_t>());
    T value;
    std::memcpy(&value,
                binary.data() + view.value("byteOffset", 0u) + accessor.value("byteOffset", 0u) +
                    (element * components + component) * sizeof(T),
                sizeof(T));
    return value;
  }
};

class StructureGltf : public testing::Test {
 protected:
  Glb PaperGlb() {
    static const std::string bytes = [&] {
      WriteStructureGlb(folder_ / "paper.glb", PaperStructure());
      return ReadFile(folder_ / "paper.glb");
    }();
    return Glb::Parse(bytes);
  }
  void ExpectBad(const std::string& bytes, std::initializer_list<std::string> parts) {
    folder_.Write("bad.glb", bytes);
    ExpectError<DataError>([&] { ReadStructureGlb(folder_ / "bad.glb"); }, parts);
    ExpectError<DataError>([&] { ReadStructureGlb(folder_ / "bad.glb"); }, {"bad.glb"});
  }
  void ExpectBadAfter(const std::function<void(Glb&)>& change,
                      std::initializer_list<std::string> parts) {
    Glb glb = PaperGlb();
    change(glb);
    ExpectBad(glb.Bytes(), parts);
  }
  /// With another value at a place of the JSON ("/nodes/1/name").
  void ExpectBadAt(const std::string& place, const json& value,
                   std::initializer_list<std::string> parts) {
    SCOPED_TRACE(place);
    ExpectBadAfter([&](Glb& glb) { glb.content[json::json_pointer(place)] = value; }, parts);
  }
  void ExpectBadWithout(const std::string& place, std::initializer_list<std::string> parts) {
    SCOPED_TRACE(place);
    const json remove = json::array({{{"op", "remove"}, {"path", place}}});
    ExpectBadAfter([&](Glb& glb) { glb.content = glb.content.patch(remove); }, parts);
  }
  static std::string PrimitiveAt(std::size_t mesh, std::size_t primitive, const char* below) {
    return fmt::format("/meshes/{}/primitives/{}/{}", mesh, primitive, below);
  }
  static json& Primitive(Glb& glb, std::size_t mesh, std::size_t primitive) {
    return glb.content["meshes"][mesh]["primitives"][primitive];
  }

  TempFolder folder_;
};

TEST_F(StructureGltf, RoundTripOfThePapersStructure) {
  const Structure structure = PaperStructure();
  WriteStructureGlb(folder_ / "a.glb", structure);
  const Structure read = ReadStructureGlb(folder_ / "a.glb");
  ExpectEqual(structure, read);
  EXPECT_EQ(structure.Hash(), read.Hash());
}

TEST_F(StructureGltf, RoundTripOfOtherStructures) {
  for (std::uint64_t index = 0; index < 6; ++index) {
    const Structure structure = RandomStructure(index, index == 0 ? 1 : index == 1 ? 12 : 5);
    WriteStructureGlb(folder_ / "a.glb", structure);
    ExpectEqual(structure, ReadStructureGlb(folder_ / "a.glb"));
  }
}

TEST_F(StructureGltf, RoundTripOfTheLargestStructure) {
  std::vector<Box> boxes;
  boxes.reserve(51);
  for (int b = 0; b < 51; ++b) {
    boxes.push_back(
        Box::FromMinMax("b" + std::to_string(b), {b * 0.3, 0, 0}, {b * 0.3 + 0.2, 0.3, 0.4}));
  }
  const Structure structure = Structure::FromBoxes("row", boxes);
  WriteStructureGlb(folder_ / "a.glb", structure);
  ExpectEqual(structure, ReadStructureGlb(folder_ / "a.glb"));
}

// One named node a box, one primitive a side, extras with side, label and
// keypoints.
TEST_F(StructureGltf, TheFileIsWhatTheDesignSays) {
  for (const Structure& structure : {PaperStructure(), RandomStructure(3, 3)}) {
    WriteStructureGlb(folder_ / "a.glb", structure);
    const Glb glb = Glb::Parse(ReadFile(folder_ / "a.glb"));
    const json& root = glb.content;
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
        EXPECT_NEAR(area, 4 * side.half_u * side.half_v, 1e-6) << side.name;
      }
      ++i;
    }
  }
}

TEST_F(StructureGltf, ReadsNodesWithAMatrixAndAParent) {
  Glb glb = PaperGlb();
  // The whole structure under a parent that turns it by 90 deg about y and lifts it by 1 m.
  json& nodes = glb.content["nodes"];
  const double h = std::sqrt(0.5);
  nodes.push_back({{"name", "stand"}, {"rotation", {0, h, 0, h}}, {"translation", {0, 1, 0}}});
  nodes.back()["children"] = glb.content["scenes"][0]["nodes"];
  glb.content["scenes"][0]["nodes"] = {nodes.size() - 1};
  // One box's transform as a column-major matrix.
  const json t = nodes[1]["translation"];
  nodes[1].erase("translation");
  nodes[1].erase("rotation");
  nodes[1]["matrix"] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, t[0], t[1], t[2], 1};
  // Keypoints are in the structure frame: (x, y, z) -> (z, y + 1, -x).
  for (json& mesh : glb.content["meshes"]) {
    for (json& primitive : mesh["primitives"]) {
      for (const char* key : {"centre", "exposed_centroid"}) {
        json& p = primitive["extras"][key];
        p = {p[2].get<double>(), p[1].get<double>() + 1, -p[0].get<double>()};
      }
    }
  }
  WriteFileAtomically(folder_ / "turned.glb", glb.Bytes());
  const Structure turned = ReadStructureGlb(folder_ / "turned.glb"), paper = PaperStructure();
  EXPECT_EQ(turned.SideNames(), paper.SideNames());
  for (int label = 1; label < 21; ++label) {
    const Vector3d p = paper.SideOfLabel(label).centre;
    EXPECT_LT((turned.SideOfLabel(label).centre - Vector3d(p.z(), p.y() + 1, -p.x())).norm(), 1e-6);
  }
}

TEST_F(StructureGltf, RejectsWrongLabels) {
  const auto label = [](std::size_t mesh, std::size_t primitive) {
    return PrimitiveAt(mesh, primitive, "extras/label");
  };
  // mid_bottom/front has 1, mid_bottom/back 2.
  ExpectBadAt(label(1, 0), 2, {"label 2", "mid_bottom/front", "mid_bottom/back"});
  ExpectBadAt(label(1, 0), 21, {"label 1 is missing"});
  ExpectBadAt(label(1, 0), 0, {"label 1 is missing"});
  ExpectBadAt(label(1, 0), -1, {"mid_bottom/front", "-1"});
  ExpectBadAt(label(1, 0), 256, {"mid_bottom/front", "256"});
  ExpectBadAt(label(1, 0), "1", {"mid_bottom/front", "label"});
  ExpectBadAt(label(1, 0), nullptr, {"mid_bottom/front", "label"});
  ExpectBadAt(label(1, 3), 21, {"mid_bottom/down"});  // a `down` side with a label
  ExpectBadAt(label(3, 5), 0, {"top/left"});  // the last label: no gap, but a side without one
  ExpectBadAfter(
      [](Glb& glb) {
        for (json& mesh : glb.content["meshes"]) {
          for (json& primitive : mesh["primitives"]) primitive["extras"]["label"] = 0;
        }
      },
      {"no side has a label"});
}

TEST_F(StructureGltf, RejectsWrongGeometry) {
  const auto move = [&](std::size_t mesh, std::size_t primitive, std::size_t vertices,
                        std::size_t axis, float by) {
    return [=](Glb& glb) {
      const json& accessor =
          glb.content["accessors"]
                     [Primitive(glb, mesh, primitive)["attributes"]["POSITION"].get<std::size_t>()];
      const json& view = glb.content["bufferViews"][accessor["bufferView"].get<std::size_t>()];
      for (std::size_t vertex = 0; vertex < vertices; ++vertex) {
        char* at =
            glb.binary.data() + view.value("byteOffset", std::size_t{0}) + 4 * (3 * vertex + axis);
        float value;
        std::memcpy(&value, at, 4);
        value += by;
        std::memcpy(at, &value, 4);
      }
    };
  };
  ExpectBadAfter(move(0, 0, 4, 0, 0.05f), {"'bottom'"});              // front outwards
  ExpectBadAfter(move(0, 0, 4, 0, -0.05f), {"'bottom'", "'front'"});  // front inwards
  ExpectBadAfter(move(2, 5, 4, 2, 0.001f), {"'mid_top'", "'left'"});
  ExpectBadAfter(move(0, 0, 1, 0, -0.05f), {"'bottom'", "'front'"});  // a corner out of the plane
  ExpectBadAfter(move(0, 2, 1, 0, 0.05f), {"bottom"});                // a corner within its plane
  ExpectBadAfter(move(0, 0, 4, 0, std::nanf("")), {"bottom/front", "NaN"});
  // Two faces swap their names.
  ExpectBadAfter(
      [](Glb& glb) {
        std::swap(Primitive(glb, 0, 0)["extras"]["side"], Primitive(glb, 0, 2)["extras"]["side"]);
      },
      {"'bottom'"});
  ExpectBadAt(PrimitiveAt(0, 0, "extras/side"), "up", {"two sides 'up'"});
  ExpectBadAt(PrimitiveAt(0, 0, "extras/side"), "north", {"'north'"});
  ExpectBadWithout("/meshes/2/primitives/4", {"'mid_top'", "'right'"});
  // A box moved as a whole, its keypoints not.
  ExpectBadAt("/nodes/3/translation/0", 0.5, {"top/", "centre"});
  ExpectBadAt(PrimitiveAt(2, 1, "extras/centre/1"), 0.3, {"mid_top/back", "centre"});
  const std::string up_centroid = PrimitiveAt(1, 2, "extras/exposed_centroid");
  ExpectBadAt(up_centroid + "/2", 0, {"mid_bottom/up", "exposed_centroid"});
  ExpectBadAt(up_centroid, {1, 2}, {"mid_bottom/up", "exposed_centroid"});
  ExpectBadAt(PrimitiveAt(1, 2, "extras/centre"), {1, 2, "x"}, {"mid_bottom/up", "centre"});
  ExpectBadWithout(PrimitiveAt(1, 2, "extras"), {"'mid_bottom'", "extras"});
  // Transforms.
  ExpectBadAt("/nodes/1/scale", {1, 2, 1}, {"'mid_bottom'", "scale"});
  ExpectBadAt("/nodes/1/rotation", {0, 0, 0, 0}, {"'mid_bottom'", "rotation"});
  ExpectBadAt("/nodes/1/rotation", {0, 0, 1}, {"'mid_bottom'", "rotation"});
  ExpectBadAt("/nodes/1/translation", {1e300, 1e300}, {"'mid_bottom'", "translation"});
  ExpectBadAt("/nodes/1/matrix", {1, 0, 0}, {"'mid_bottom'", "matrix"});
  ExpectBadAt("/nodes/1/matrix", {2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1},
              {"'mid_bottom'", "matrix"});
  // Names.
  ExpectBadWithout("/nodes/1/name", {"empty"});
  ExpectBadAt("/nodes/1/name", "top", {"top"});
  // Buffers.
  const std::string attributes = PrimitiveAt(0, 0, "attributes");
  const std::string accessor =
      "/accessors/" + PaperGlb().content[json::json_pointer(attributes + "/POSITION")].dump();
  for (const std::int64_t count : {std::int64_t{400000}, 1537228672809129302, std::int64_t{0}})
    ExpectBadAt(accessor + "/count", count, {});
  ExpectBadAt(accessor + "/bufferView", 4000, {});
  ExpectBadAt(accessor + "/type", "VEC2", {});
  ExpectBadAt(accessor + "/byteOffset", 1u << 30, {});
  ExpectBadAt("/bufferViews/0/byteOffset", 1u << 30, {});
  ExpectBadWithout(attributes + "/POSITION", {"POSITION"});
  ExpectBadAt(attributes + "/POSITION", 9999, {"POSITION"});
}

// tinygltf would open what a file names: a buffer's or an image's file, a pipe.
TEST_F(StructureGltf, OpensNoOtherFile) {
  const std::string secret = folder_.Write("secret", "0123456789").string();
  for (const char* list : {"buffers", "images"}) {
    ExpectBadAfter(
        [&](Glb& glb) {
          glb.content[list].push_back({{"uri", secret}, {"byteLength", 4}});
        },
        {"names another file", "secret", "one .glb"});
    ExpectBadAfter(
        [&](Glb& glb) {
          glb.content[list].push_back({{"uri", 3}});
        },
        {"names another file"});
  }
  ::mkfifo((folder_ / "pipe").c_str(), 0600);
  ExpectBadAfter(
      [&](Glb& glb) {
        glb.content["buffers"][0] = {{"uri", (folder_ / "pipe").string()}, {"byteLength", 4}};
      },
      {"names another file"});
}

// Written as text: a value that is so deep would end this program, too.
TEST_F(StructureGltf, LimitsDepth) {
  constexpr std::size_t kDeep = 100000;
  Glb glb = PaperGlb();
  const auto with = [&](json& place, const std::string& text) {
    place = "@";
    std::string whole = glb.content.dump();
    whole.replace(whole.find("\"@\""), 3, text);
    return glb.Bytes(whole);
  };
  json& more = glb.content["scenes"][0]["extras"]["more"];
  ExpectBad(with(more, std::string(kDeep, '[') + std::string(kDeep, ']')), {"64 levels"});
  more = 0;
  glb.content["scenes"][0]["nodes"] = {0};
  const auto chain = [](std::size_t length) {
    std::string nodes = "[";
    for (std::size_t i = 1; i < length; ++i) nodes += "{\"children\":[" + std::to_string(i) + "]},";
    return nodes + "{}]";
  };
  ExpectBad(with(glb.content["nodes"], chain(10)), {"no side has a label"});
  ExpectBad(with(glb.content["nodes"], chain(1000)), {"64 levels"});
}

TEST_F(StructureGltf, LimitsPoints) {
  // One buffer of zeros, which a side and a hundred thousand others could go through each.
  ExpectBadAfter(
      [](Glb& glb) {
        glb.binary.resize(glb.binary.size() + std::size_t{12} * 10001);
        glb.content["buffers"][0]["byteLength"] = glb.binary.size();
        json& accessor =
            glb.content["accessors"]
                       [Primitive(glb, 0, 0)["attributes"]["POSITION"].get<std::size_t>()];
        const std::size_t view = accessor["bufferView"].get<std::size_t>();
        glb.content["bufferViews"][view]["byteLength"] = 12 * 10001;
        accessor["count"] = 10001;
      },
      {"10001 points"});
  ExpectBadAfter(
      [](Glb& glb) {
        for (json& primitive : glb.content["meshes"][0]["primitives"])
          primitive["extras"]["label"] = 0;
        for (int i = 0; i < 60; ++i) {
          glb.content["scenes"][0]["nodes"].push_back(glb.content["nodes"].size());
          glb.content["nodes"].push_back({{"mesh", 0}});
        }
      },
      {"more than 51 boxes"});
}

TEST_F(StructureGltf, RejectsWrongScenes) {
  ExpectBadWithout("/scenes", {"scene"});
  ExpectBadAt("/scene", 7, {"scene"});
  ExpectBadAt("/scenes/0/nodes", json::array(), {});
  ExpectBadAt("/scenes/0/nodes/0", 99, {"tree"});
  ExpectBadWithout("/scenes/0/extras", {"format"});
  ExpectBadAt("/scenes/0/extras/format", "volalign.structure/9",
              {"volalign.structure/9", "volalign structure build"});
  ExpectBadAt("/nodes/0/mesh", 44, {"tree"});
  // A node that is its own grandchild, many times over.
  ExpectBadAfter(
      [](Glb& glb) {
        const std::size_t n = glb.content["nodes"].size();
        glb.content["nodes"].push_back({{"name", "a"}, {"children", {n, n, n, n}}});
        glb.content["scenes"][0]["nodes"] = {n};
      },
      {"tree"});
}

TEST_F(StructureGltf, RejectsTruncatedFiles) {
  const std::string bytes = PaperGlb().Bytes();
  for (std::size_t size = 0; size < bytes.size(); size += 97) {
    SCOPED_TRACE(size);
    ExpectBad(bytes.substr(0, size), {});
  }
  ExpectBad(bytes.substr(0, bytes.size() - 1), {});
}

TEST_F(StructureGltf, FlippedBytesNeverCrash) {
  const std::string bytes = PaperGlb().Bytes();
  RandomStream random(8, 0, "flip");
  int refused = 0;
  for (int i = 0; i < 800; ++i) {
    std::string broken = bytes;
    const int at = i < 40 ? i : random.Below(static_cast<int>(bytes.size()));
    broken[static_cast<std::size_t>(at)] =
        static_cast<char>(i % 2 ? random.Below(256) : '0' + random.Below(10));
    folder_.Write("flip.glb", broken);
    try {
      ReadStructureGlb(folder_ / "flip.glb");
    } catch (const DataError& e) {
      EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos) << e.what();
      ++refused;
    }
  }
  EXPECT_GT(refused, 200);
}

TEST_F(StructureGltf, RejectsOtherFiles) {
  ExpectBad("", {});
  ExpectBad("glTF", {});
  ExpectBad(std::string(1000, 'x'), {});
  ExpectError<IoError>([&] { ReadStructureGlb(folder_ / "missing.glb"); }, {"missing.glb"});
  ExpectError<IoError>([&] { WriteStructureGlb("/proc/none/a.glb", PaperStructure()); },
                       {"/proc/none"});
}

TEST_F(StructureGltf, ReadStructureGoesByExtension) {
  WriteStructureGlb(folder_ / "a.glb", PaperStructure());
  EXPECT_EQ(ReadStructure(folder_ / "a.glb").Hash(),
            ReadStructure("configs/structure.yaml").Hash());
  std::filesystem::copy_file("configs/structure.yaml", folder_ / "b.yml");
  EXPECT_EQ(ReadStructure(folder_ / "b.yml").Hash(), PaperStructure().Hash());
  ExpectError<DataError>([&] { ReadStructure(folder_ / "a.obj"); }, {"a.obj", ".glb"});
}

}  // namespace
}  // namespace volalign::structure_gltf_test

#include "core/formats/gltf_parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <sstream>
#include <type_traits>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/formats/structure_gltf.h"
#include "core/plot/picture.h"

namespace volalign {

namespace {

void Append(const Eigen::Vector3d& v, std::vector<float>* numbers) {
  for (const double x : v) numbers->push_back(static_cast<float>(x));
}

using Triangles = std::vector<std::array<Eigen::Vector3d, 3>>;

/// A side without material and extras. `triangles`: of a mesh's side.
tinygltf::Primitive MakeShape(tinygltf::Model* model, const Box& box, const Side& side,
                              const Triangles& triangles) {
  const Pose box_from_structure = box.structure_from_box.inverse();
  std::vector<float> positions, normals;
  if (box.mesh) {
    for (const auto& triangle : triangles) {
      const Eigen::Vector3d across = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
      const Eigen::Vector3d normal = across.norm() > 0 ? across.normalized() : side.normal;
      for (const Eigen::Vector3d& corner : triangle) {
        Append(box_from_structure * corner, &positions);
        Append(box_from_structure.linear() * normal, &normals);
      }
    }
  } else {
    for (const auto& [su, sv] : {std::pair(-1, -1), {1, -1}, {1, 1}, {-1, 1}}) {
      Append(box_from_structure * Eigen::Vector3d(side.centre + su * side.half_u * side.axis_u +
                                                  sv * side.half_v * side.axis_v),
             &positions);
      Append(box_from_structure.linear() * side.normal, &normals);
    }
  }
  tinygltf::Primitive primitive;
  primitive.mode = TINYGLTF_MODE_TRIANGLES;
  primitive.attributes["POSITION"] = AddPositions(model, positions);
  primitive.attributes["NORMAL"] = AddAccessor(model, normals, TINYGLTF_TYPE_VEC3);
  if (!box.mesh)
    primitive.indices = AddAccessor<std::uint16_t>(model, {0, 1, 2, 0, 2, 3}, TINYGLTF_TYPE_SCALAR);
  return primitive;
}

tinygltf::Primitive MakePrimitive(tinygltf::Model* model, const Box& box, const Side& side,
                                  const Triangles& triangles) {
  tinygltf::Primitive primitive = MakeShape(model, box, side, triangles);
  tinygltf::Value::Object extras;
  extras["side"] = tinygltf::Value(side.name.substr(box.name.size() + 1));
  extras["label"] = tinygltf::Value(static_cast<int>(side.label));
  extras["centre"] = Numbers({side.centre.x(), side.centre.y(), side.centre.z()});
  const Eigen::Vector3d& exposed = side.exposed_centroid;
  extras["exposed_centroid"] = Numbers({exposed.x(), exposed.y(), exposed.z()});
  primitive.extras = tinygltf::Value(std::move(extras));

  const Rgb colour = side.label == 0 ? Rgb{90, 90, 90} : LabelColour(side.label);
  tinygltf::Material material;
  material.name = side.name;
  material.pbrMetallicRoughness.baseColorFactor = {colour.r / 255.0, colour.g / 255.0,
                                                   colour.b / 255.0, 1};
  material.pbrMetallicRoughness.metallicFactor = 0;
  model->materials.push_back(material);
  primitive.material = static_cast<int>(model->materials.size()) - 1;
  return primitive;
}

}  // namespace

tinygltf::Value Numbers(const std::vector<double>& numbers) {
  return tinygltf::Value(tinygltf::Value::Array(numbers.begin(), numbers.end()));
}

tinygltf::Model NewGltf(const std::string& scene_name) {
  tinygltf::Model model;
  model.asset.version = "2.0";
  model.asset.generator = "volalign";
  model.buffers.emplace_back();
  model.scenes.emplace_back();
  model.scenes[0].name = scene_name;
  model.defaultScene = 0;
  return model;
}

template <class T>
int AddAccessor(tinygltf::Model* model, const std::vector<T>& values, int type) {
  constexpr bool kIsIndex = std::is_same_v<T, std::uint16_t>,
                 kIsByte = std::is_same_v<T, std::uint8_t>;
  auto& bytes = model->buffers[0].data;
  while (bytes.size() % 4 != 0) bytes.push_back(0);
  tinygltf::BufferView view;
  view.buffer = 0;
  view.byteOffset = bytes.size();
  view.byteLength = values.size() * sizeof(T);
  view.target = kIsIndex ? TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER : TINYGLTF_TARGET_ARRAY_BUFFER;
  const auto* raw = reinterpret_cast<const unsigned char*>(values.data());
  bytes.insert(bytes.end(), raw, raw + view.byteLength);
  model->bufferViews.push_back(view);
  tinygltf::Accessor accessor;
  accessor.bufferView = static_cast<int>(model->bufferViews.size()) - 1;
  accessor.componentType = kIsIndex  ? TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT
                           : kIsByte ? TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE
                                     : TINYGLTF_COMPONENT_TYPE_FLOAT;
  accessor.type = type;
  accessor.normalized = kIsByte;
  accessor.count =
      values.size() /
      static_cast<std::size_t>(tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(type)));
  model->accessors.push_back(accessor);
  return static_cast<int>(model->accessors.size()) - 1;
}
template int AddAccessor(tinygltf::Model*, const std::vector<std::uint16_t>&, int);
template int AddAccessor(tinygltf::Model*, const std::vector<std::uint8_t>&, int);

int AddPositions(tinygltf::Model* model, const std::vector<float>& positions) {
  const int index = AddAccessor(model, positions, TINYGLTF_TYPE_VEC3);
  std::vector<double> low(3, 1e9), high(3, -1e9);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    low[i % 3] = std::min<double>(low[i % 3], positions[i]);
    high[i % 3] = std::max<double>(high[i % 3], positions[i]);
  }
  auto& accessor = model->accessors[static_cast<std::size_t>(index)];
  accessor.minValues = low;
  accessor.maxValues = high;
  return index;
}

void SetPose(tinygltf::Node* node, const Pose& parent_from_node) {
  const Eigen::Vector3d t = parent_from_node.translation();
  const Eigen::Quaterniond q(parent_from_node.linear());
  node->translation = {t.x(), t.y(), t.z()};
  node->rotation = {q.x(), q.y(), q.z(), q.w()};
}

int AddNode(tinygltf::Model* model, tinygltf::Node node) {
  model->nodes.push_back(std::move(node));
  return static_cast<int>(model->nodes.size()) - 1;
}

int AddMesh(tinygltf::Model* model, tinygltf::Mesh mesh) {
  model->meshes.push_back(std::move(mesh));
  return static_cast<int>(model->meshes.size()) - 1;
}

std::vector<int> AddBoxes(tinygltf::Model* model, const Structure& structure) {
  std::vector<int> nodes;
  for (std::size_t b = 0; b < structure.boxes().size(); ++b) {
    const Box& box = structure.boxes()[b];
    tinygltf::Mesh mesh;
    mesh.name = box.name;
    const std::vector<Triangles> triangles =
        box.mesh ? box.TrianglesBySide() : std::vector<Triangles>(kFaces.size());
    for (const Side& side : structure.sides()) {
      if (side.box == static_cast<int>(b))
        mesh.primitives.push_back(
            MakePrimitive(model, box, side, triangles[static_cast<std::size_t>(side.index)]));
    }
    tinygltf::Node node;
    node.name = box.name;
    node.mesh = AddMesh(model, std::move(mesh));
    SetPose(&node, box.structure_from_box);
    nodes.push_back(AddNode(model, std::move(node)));
  }
  return nodes;
}

void WriteStructureGlb(const std::filesystem::path& path, const Structure& structure) {
  tinygltf::Model model = NewGltf(structure.name());
  model.scenes[0].extras = tinygltf::Value(
      tinygltf::Value::Object{{"format", tinygltf::Value(std::string("volalign.structure/1"))},
                              {"name", tinygltf::Value(structure.name())}});
  model.scenes[0].nodes = AddBoxes(&model, structure);
  WriteGlb(path, model);
}

void WriteGlb(const std::filesystem::path& path, const tinygltf::Model& model) {
  std::ostringstream bytes;
  tinygltf::TinyGLTF writer;
  if (!writer.WriteGltfSceneToStream(&model, bytes, false, true))
    throw Error(fmt::format("{}: glTF encoding failed", path.string()));
  WriteFileAtomically(path, bytes.str());
}

}  // namespace volalign

#include "core/formats/structure_gltf.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/base/text.h"
#include "core/formats/gltf_parts.h"
#include "core/json/strict_json.h"
#include "core/plot/picture.h"

namespace volalign {

namespace {

constexpr char kFormat[] = "volalign.structure/1";
constexpr double kGeometryTolerance = 1e-4;  // m
constexpr std::size_t kLongestMessage = 500;
constexpr std::size_t kMostPoints = 10000;  // of a side, which is a rectangle

/// Reads structures out of a parsed model; `where` names file and node in every message.
class Reader {
 public:
  Reader(const tinygltf::Model& model, std::string file) : model_(model), file_(std::move(file)) {}

  Structure Read() {
    if (model_.scenes.empty()) Fail("no scene");
    const std::size_t index =
        model_.defaultScene < 0 ? 0 : static_cast<std::size_t>(model_.defaultScene);
    if (index >= model_.scenes.size()) Fail("the default scene does not exist");
    const tinygltf::Scene& scene = model_.scenes[index];
    const std::string format = Text(scene.extras, "format", "the scene");
    if (format != kFormat) {
      Fail(fmt::format(
          "format '{}' where '{}' is expected; write the file with `volalign structure build`",
          format, kFormat));
    }
    for (const int node : scene.nodes) Visit(node, Pose::Identity(), 1);
    if (labels_.empty()) Fail("no side has a label");
    std::vector<std::string> order;
    for (const auto& [label, name] : labels_) {
      if (label != static_cast<int>(order.size()) + 1) {
        Fail(fmt::format("label {} is missing; labels run from 1 without gaps", order.size() + 1));
      }
      order.push_back(name);
    }
    Structure structure;
    try {
      structure = Structure::FromBoxes(Text(scene.extras, "name", "the scene"), boxes_, order);
    } catch (const DataError& e) {
      Fail(e.what());
    }
    std::map<std::string, const Side*> sides;
    for (const Side& side : structure.sides()) sides[side.name] = &side;
    for (const Claim& claim : claims_) {
      if (!((sides.at(claim.side)->centre - claim.centre).norm() <= kGeometryTolerance)) {
        Fail(fmt::format("{}: extras.centre contradicts the geometry", claim.side));
      }
    }
    // After all centres: a box that was moved also changes what it covers of its neighbours.
    for (const Claim& claim : claims_) {
      const Eigen::Vector3d& expected = sides.at(claim.side)->exposed_centroid;
      if (!((expected - claim.exposed_centroid).norm() <= 10 * kGeometryTolerance)) {
        Fail(fmt::format("{}: extras.exposed_centroid contradicts the geometry", claim.side));
      }
    }
    return structure;
  }

 private:
  struct Claim {
    std::string side;
    Eigen::Vector3d centre, exposed_centroid;
  };

  [[noreturn]] void Fail(const std::string& what) const {
    throw DataError(file_ + ": " + Shortened(what, kLongestMessage));
  }

  std::string Text(const tinygltf::Value& extras, const char* key, const std::string& what) const {
    if (!extras.IsObject() || !extras.Has(key) || !extras.Get(key).IsString()) {
      Fail(fmt::format("{} has no extras.{}; write the file with `volalign structure build`", what,
                       key));
    }
    return extras.Get(key).Get<std::string>();
  }

  Eigen::Vector3d Point(const tinygltf::Value& extras, const char* key,
                        const std::string& what) const {
    if (!extras.Has(key) || !extras.Get(key).IsArray() || extras.Get(key).ArrayLen() != 3) {
      Fail(fmt::format("{} has no extras.{} of three numbers", what, key));
    }
    Eigen::Vector3d p;
    for (int i = 0; i < 3; ++i) {
      const tinygltf::Value& x = extras.Get(key).Get(static_cast<std::size_t>(i));
      if (!x.IsNumber())
        Fail(fmt::format("{}: extras.{} holds something that is no number", what, key));
      p[i] = x.GetNumberAsDouble();
    }
    return p;
  }

  Pose LocalPose(const tinygltf::Node& node) const {
    Pose pose = Pose::Identity();
    if (!node.matrix.empty()) {
      if (node.matrix.size() != 16)
        Fail(fmt::format("node '{}': matrix wants 16 numbers", node.name));
      const Eigen::Matrix4d m =
          Eigen::Map<const Eigen::Matrix4d>(node.matrix.data());  // column-major, as glTF has it
      return PoseFromRows({{m(0, 0), m(0, 1), m(0, 2), m(0, 3)},
                           {m(1, 0), m(1, 1), m(1, 2), m(1, 3)},
                           {m(2, 0), m(2, 1), m(2, 2), m(2, 3)},
                           {m(3, 0), m(3, 1), m(3, 2), m(3, 3)}},
                          fmt::format("{}: node '{}': matrix", file_, node.name));
    }
    for (const double s : node.scale) {
      if (std::abs(s - 1) > 1e-6)
        Fail(fmt::format("node '{}' is scaled; apply the scale to its mesh", node.name));
    }
    if (!node.rotation.empty()) {
      const double norm = node.rotation.size() == 4
                              ? Eigen::Map<const Eigen::Vector4d>(node.rotation.data()).norm()
                              : 0;
      if (!(std::abs(norm - 1) < 1e-3))
        Fail(fmt::format("node '{}': rotation is no unit quaternion", node.name));
      pose.linear() =
          Eigen::Quaterniond(node.rotation[3], node.rotation[0], node.rotation[1], node.rotation[2])
              .normalized()
              .toRotationMatrix();
    }
    if (!node.translation.empty()) {
      if (node.translation.size() != 3)
        Fail(fmt::format("node '{}': translation wants three numbers", node.name));
      pose.translation() = Eigen::Map<const Eigen::Vector3d>(node.translation.data());
    }
    return pose;
  }

  std::vector<Eigen::Vector3d> Positions(const tinygltf::Primitive& primitive,
                                         const std::string& what) const {
    const auto found = primitive.attributes.find("POSITION");
    const auto in = [](int i, std::size_t size) {
      return i >= 0 && static_cast<std::size_t>(i) < size;
    };
    if (found == primitive.attributes.end() || !in(found->second, model_.accessors.size())) {
      Fail(what + " has no POSITION");
    }
    const tinygltf::Accessor& accessor = model_.accessors[static_cast<std::size_t>(found->second)];
    if (accessor.componentType != TINYGLTF_COMPONENT_TYPE_FLOAT ||
        accessor.type != TINYGLTF_TYPE_VEC3 || accessor.count == 0 ||
        !in(accessor.bufferView, model_.bufferViews.size())) {
      Fail(what + ": POSITION is not a list of float triples");
    }
    const tinygltf::BufferView& view =
        model_.bufferViews[static_cast<std::size_t>(accessor.bufferView)];
    const int stride = accessor.ByteStride(view);
    if (!in(view.buffer, model_.buffers.size()) || stride <= 0)
      Fail(what + ": POSITION has no buffer");
    const auto& bytes = model_.buffers[static_cast<std::size_t>(view.buffer)].data;
    const std::size_t begin = view.byteOffset + accessor.byteOffset;
    if (view.byteOffset > bytes.size() || begin > bytes.size() || accessor.count > bytes.size() ||
        begin + (accessor.count - 1) * static_cast<std::size_t>(stride) + 12 > bytes.size()) {
      Fail(what + ": POSITION runs past the end of its buffer");
    }
    if (accessor.count > kMostPoints)
      Fail(fmt::format("{}: POSITION has {} points, more than {}", what, accessor.count,
                       kMostPoints));
    std::vector<Eigen::Vector3d> points;
    for (std::size_t i = 0; i < accessor.count; ++i) {
      float xyz[3];
      std::memcpy(xyz, bytes.data() + begin + i * static_cast<std::size_t>(stride), sizeof(xyz));
      points.emplace_back(xyz[0], xyz[1], xyz[2]);
      if (!points.back().allFinite()) Fail(what + ": POSITION holds a NaN");
    }
    return points;
  }

  void Visit(int index, const Pose& scene_from_parent, int depth) {
    if (depth > kMaxJsonDepth)
      Fail(fmt::format("nodes are nested deeper than {} levels", kMaxJsonDepth));
    if (index < 0 || static_cast<std::size_t>(index) >= model_.nodes.size() ||
        ++visited_ > model_.nodes.size()) {
      Fail("the node tree is broken");
    }
    const tinygltf::Node& node = model_.nodes[static_cast<std::size_t>(index)];
    const Pose scene_from_node = scene_from_parent * LocalPose(node);
    if (node.mesh >= 0) ReadBox(node, scene_from_node);
    for (const int child : node.children) Visit(child, scene_from_node, depth + 1);
  }

  void ReadBox(const tinygltf::Node& node, const Pose& scene_from_node) {
    if (static_cast<std::size_t>(node.mesh) >= model_.meshes.size())
      Fail("the node tree is broken");
    if (static_cast<int>(boxes_.size()) >= kMaxBoxes)
      Fail(fmt::format("more than {} boxes", kMaxBoxes));
    const tinygltf::Mesh& mesh = model_.meshes[static_cast<std::size_t>(node.mesh)];
    Eigen::Vector3d low = Eigen::Vector3d::Constant(1e9), high = -low;
    std::map<std::string, std::vector<Eigen::Vector3d>> faces;
    for (const tinygltf::Primitive& primitive : mesh.primitives) {
      const std::string what = fmt::format("node '{}'", node.name);
      const std::string face = Text(primitive.extras, "side", what);
      if (std::none_of(std::begin(kFaces), std::end(kFaces),
                       [&](Face f) { return face == FaceName(f); }))
        Fail(fmt::format("{} has a side '{}'", what, Shortened(face)));
      const auto points = Positions(primitive, node.name + "/" + face);
      if (!faces.emplace(face, points).second)
        Fail(fmt::format("{} has two sides '{}'", what, face));
      for (const auto& p : points) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
      }
      const std::string side = node.name + "/" + face;
      if (!primitive.extras.Has("label") || !primitive.extras.Get("label").IsInt()) {
        Fail(side + " has no extras.label");
      }
      const int label = primitive.extras.Get("label").Get<int>();
      if (label < 0 || label > 255)
        Fail(fmt::format("{}: label {} violates 0 <= label <= 255", side, label));
      if (label > 0 && !labels_.emplace(label, side).second) {
        Fail(fmt::format("label {} belongs to both {} and {}", label, labels_.at(label), side));
      }
      claims_.push_back({side, Point(primitive.extras, "centre", side),
                         Point(primitive.extras, "exposed_centroid", side)});
    }
    Box box;
    box.name = node.name;
    box.size = high - low;
    box.structure_from_box = scene_from_node * Eigen::Translation3d((low + high) / 2);
    for (const Face face : kFaces) {
      const auto found = faces.find(FaceName(face));
      if (found == faces.end())
        Fail(fmt::format("node '{}' has no side '{}'", node.name, FaceName(face)));
      const Eigen::Vector3d normal = FaceNormal(face);
      const double expected = normal.dot(normal.sum() > 0 ? high : low);
      for (const auto& p : found->second) {
        if (std::abs(p.dot(normal) - expected) > kGeometryTolerance) {
          Fail(
              fmt::format("node '{}': side '{}' does not lie on that face of the box (at {:.4f} m, "
                          "not {:.4f} m)",
                          node.name, FaceName(face), p.dot(normal), expected));
        }
      }
      for (int i = 0; i < 8; ++i) {
        const Eigen::Vector3d corner((i & 1 ? high : low).x(), (i & 2 ? high : low).y(),
                                     (i & 4 ? high : low).z());
        const bool on_face = std::abs(corner.dot(normal) - expected) < kGeometryTolerance;
        const bool drawn = std::any_of(
            found->second.begin(), found->second.end(),
            [&](const Eigen::Vector3d& p) { return (p - corner).norm() < 2 * kGeometryTolerance; });
        if (on_face && !drawn) {
          Fail(
              fmt::format("node '{}': side '{}' does not reach the box's corner ({:.4f}, {:.4f}, "
                          "{:.4f}) m",
                          node.name, FaceName(face), corner.x(), corner.y(), corner.z()));
        }
      }
    }
    boxes_.push_back(box);
  }

  const tinygltf::Model& model_;
  std::string file_;
  std::vector<Box> boxes_;
  std::map<int, std::string> labels_;
  std::vector<Claim> claims_;
  std::size_t visited_ = 0;  // a tree's nodes are visited once each; more means a cycle
};

/// Of an untrusted file: tinygltf parses JSON by recursion, and opens the files that it names.
/// Throws DataError for JSON beyond ParseBoundedJson's limits, for names of files, and for what the
/// reader would pass over; what is no binary glTF at all is left to tinygltf.
void RequireSelfContained(const std::string& bytes, const std::string& name) {
  constexpr std::size_t kLengthAt = 12, kJsonAt = 20;
  if (bytes.size() < kJsonAt) return;
  std::size_t length = 0;
  for (std::size_t i = 0; i < 4; ++i)
    length |= static_cast<std::size_t>(static_cast<unsigned char>(bytes[kLengthAt + i])) << (8 * i);
  if (length > bytes.size() - kJsonAt) return;
  const nlohmann::json document = ParseBoundedJson(bytes.substr(kJsonAt, length), name);
  if (!document.is_object()) return;
  const auto refuse = [&](const char* what) {
    throw DataError(
        fmt::format("{}: it has {}, of which volalign knows none; write it without", name, what));
  };
  if (!document.value("extensionsRequired", nlohmann::json::array()).empty())
    refuse("required extensions");
  for (const nlohmann::json& accessor : document.value("accessors", nlohmann::json::array()))
    if (accessor.is_object() && accessor.contains("sparse")) refuse("sparse accessors");
  for (const char* list : {"buffers", "images"}) {
    if (!document.contains(list)) continue;
    for (const nlohmann::json& item : document[list]) {
      if (!item.is_object() || !item.contains("uri")) continue;
      if (!item["uri"].is_string() || item["uri"].get<std::string>().rfind("data:", 0) != 0) {
        throw DataError(
            fmt::format("{}: it names another file, {}, and volalign reads none; write it with its "
                        "data inside, as one .glb",
                        name, ShownJson(item["uri"])));
      }
    }
  }
}

/// Should a version of tinygltf look for files elsewhere, it finds none.
tinygltf::FsCallbacks NoFiles() {
  tinygltf::FsCallbacks none{};
  none.FileExists = [](const std::string&, void*) { return false; };
  none.ExpandFilePath = [](const std::string&, void*) { return std::string(); };
  none.ReadWholeFile = [](std::vector<unsigned char>*, std::string*, const std::string&, void*) {
    return false;
  };
  none.WriteWholeFile = [](std::string*, const std::string&, const std::vector<unsigned char>&,
                           void*) { return false; };
  return none;
}

}  // namespace

void WriteStructureGlb(const std::filesystem::path& path, const Structure& structure) {
  tinygltf::Model model = NewGltf(structure.name());
  model.scenes[0].extras =
      tinygltf::Value(tinygltf::Value::Object{{"format", tinygltf::Value(std::string(kFormat))},
                                              {"name", tinygltf::Value(structure.name())}});
  model.scenes[0].nodes = AddBoxes(&model, structure);
  WriteGlb(path, model);
}

Structure ReadStructureGlb(const std::filesystem::path& path) {
  const std::string bytes = ReadFile(FindInputFile(path.string()), kMaxResultBytes);
  RequireSelfContained(bytes, path.string());
  tinygltf::TinyGLTF loader;
  loader.SetFsCallbacks(NoFiles());
  tinygltf::Model model;
  std::string error, warning;
  const bool parsed = loader.LoadBinaryFromMemory(
      &model, &error, &warning, reinterpret_cast<const unsigned char*>(bytes.data()),
      static_cast<unsigned int>(bytes.size()));
  if (!parsed) {
    error = Shortened(error.substr(0, error.find('\n')));
    throw DataError(fmt::format("{}: not a binary glTF 2.0 file: {}", path.string(),
                                error.empty() ? "unknown content" : error));
  }
  return Reader(model, path.string()).Read();
}

Structure ReadStructure(const std::filesystem::path& path) {
  const std::string extension = path.extension().string();
  if (extension == ".glb") return ReadStructureGlb(path);
  if (extension == ".yaml" || extension == ".yml") return ReadStructureYaml(path.string());
  throw DataError(fmt::format("{}: a structure is a .glb or .yaml file", path.string()));
}

}  // namespace volalign

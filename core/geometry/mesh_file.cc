#include "core/geometry/mesh_file.h"

#include <assimp/DefaultIOSystem.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <assimp/Importer.hpp>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <system_error>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/number.h"
#include "core/base/text.h"

namespace volalign {

namespace {

constexpr double kSmallest = 0.05, kLargest = 50;  // m
constexpr std::array<const char*, 5> kEndings{".glb", ".gltf", ".obj", ".stl", ".ply"};
constexpr int kMostParts = kMaxBoxes;

std::string EndingOf(const std::filesystem::path& path) { return Lower(path.extension().string()); }

Eigen::Matrix3d UpwardsFrom(MeshUp up) {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  if (up == MeshUp::kZ) turn << 1, 0, 0, 0, 0, 1, 0, -1, 0;  // x stays
  if (up == MeshUp::kX) turn << 0, -1, 0, 1, 0, 0, 0, 0, 1;  // z stays
  return turn;
}

/// A part's name: plain, without '/', and not that of a part before. Assimp calls an object of an
/// OBJ without a name "defaultobject".
std::string NameOf(const aiString& given, const std::string& otherwise,
                   std::set<std::string>* taken) {
  std::string name(given.C_Str());
  std::replace(name.begin(), name.end(), '/', '_');
  if (name.empty() || name == "defaultobject" || !IsPlainName(name)) name = otherwise;
  std::string unique = name;
  for (int i = 2; !taken->insert(unique).second; ++i) unique = fmt::format("{}_{}", name, i);
  return unique;
}

/// Throws DataError for a .gltf or .glb that Assimp might read otherwise than by the standard, or
/// whose nodes it would visit more often or deeper than is safe.
void RequireShallow(const std::string& bytes) {
  using Json = nlohmann::json;
  constexpr std::size_t kHeader = 20;  // of a .glb and of its first chunk
  constexpr int kDeepest = 64;
  constexpr double kMostVertices = 5e7;  // with their normals and other attributes
  std::string document = bytes;
  if (bytes.compare(0, 4, "glTF") == 0) {
    if (bytes.size() < kHeader) throw DataError("it is cut off");
    std::uint32_t size = 0;
    std::memcpy(&size, bytes.data() + 12, sizeof size);
    document = bytes.substr(kHeader, size);
  }
  document.resize(document.find_last_not_of('\0') + 1);  // with which some programs pad it
  std::vector<std::set<std::string>> keys;               // of the objects that are open
  const auto check = [&](int depth, Json::parse_event_t event, const Json& parsed) {
    if (depth > kDeepest)
      throw DataError(fmt::format("it is nested deeper than {} levels", kDeepest));
    if (event == Json::parse_event_t::object_start) keys.emplace_back();
    if (event == Json::parse_event_t::object_end) keys.pop_back();
    if (event == Json::parse_event_t::key && !keys.back().insert(parsed.get<std::string>()).second)
      throw DataError(fmt::format("the key {} stands twice in one object", parsed.dump()));
    return true;
  };
  try {
    const Json json = Json::parse(document, check);
    const Json nodes = json.value("nodes", Json::array()),
               accessors = json.value("accessors", Json::array());
    if (!nodes.is_array()) throw DataError("its nodes are no list: glTF 2 is read");
    std::vector<int> parent(nodes.size(), -1);
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      for (const Json& child : nodes[i].value("children", Json::array())) {
        if (!child.is_number_unsigned() || child >= nodes.size() ||
            std::exchange(parent[child.get<std::size_t>()], static_cast<int>(i)) >= 0)
          throw DataError("a node is the child of two nodes, or of none that there is");
      }
    }
    for (int at : parent) {
      for (int levels = 2; at >= 0; at = parent[static_cast<std::size_t>(at)])
        if (levels++ > kDeepest)
          throw DataError(fmt::format("its nodes are nested deeper than {} levels", kDeepest));
    }
    for (const Json& scene : json.value("scenes", Json::array())) {
      const Json roots = scene.value("nodes", Json::array());
      if (std::set<Json>(roots.begin(), roots.end()).size() < roots.size())
        throw DataError("a scene has a node twice");
    }
    double vertices = 0;  // Assimp copies those of each primitive, also where many have the same
    for (const Json& mesh : json.value("meshes", Json::array()))
      for (const Json& primitive : mesh.value("primitives", Json::array()))
        for (const Json& number : primitive.flatten())
          if (number.is_number_unsigned() && number < accessors.size())
            vertices += accessors[number.get<std::size_t>()].value("count", 0.0);
    if (vertices > kMostVertices)
      throw DataError(fmt::format("its primitives have more than {:g} vertices", kMostVertices));
  } catch (const Json::exception&) {
    throw DataError("its JSON has a fault");
  }
}

/// Throws DataError for a .ply whose header promises more than the file can have.
void RequirePromised(const std::string& bytes) {
  for (std::size_t at = bytes.find("element "); at != std::string::npos && at < 4096;
       at = bytes.find("element ", at + 1)) {
    const std::size_t number = bytes.find(' ', at + 8);
    const auto count =
        number == std::string::npos
            ? std::nullopt
            : NumberOf(bytes.substr(number + 1, bytes.find_first_of("\r\n", number) - number - 1));
    if (count && *count > static_cast<double>(bytes.size()))
      throw DataError("it is cut off: its header promises more than it has");
  }
}

/// Opens the mesh itself, and buffers (.bin) beside it, which a .gltf names. Nothing else that a
/// file names is opened.
class OnlyBeside : public Assimp::DefaultIOSystem {
 public:
  explicit OnlyBeside(const std::filesystem::path& mesh) : mesh_(mesh.lexically_normal()) {}
  bool Exists(const char* file) const override {
    return IsAllowed(file) && DefaultIOSystem::Exists(file);
  }
  Assimp::IOStream* Open(const char* file, const char* mode) override {
    return IsAllowed(file) ? DefaultIOSystem::Open(file, mode) : nullptr;
  }

 private:
  bool IsAllowed(const std::filesystem::path& file) const {
    const std::filesystem::path path = file.lexically_normal();
    if (path == mesh_) return true;
    std::error_code error;
    return path.parent_path() == mesh_.parent_path() && path.extension() == ".bin" &&
           std::filesystem::is_regular_file(path, error) &&
           std::filesystem::file_size(path, error) <= kMaxResultBytes;
  }

  std::filesystem::path mesh_;
};

class Reader {
 public:
  Reader(const aiScene& scene, const Eigen::Matrix3d& structure_from_file, std::string name)
      : scene_(scene), turn_(structure_from_file), name_(std::move(name)) {
    Visit(*scene.mRootNode, aiMatrix4x4());
  }
  std::vector<Box> Take() { return std::move(parts_); }

 private:
  void Visit(const aiNode& node, const aiMatrix4x4& parent) {
    const aiMatrix4x4 place = parent * node.mTransformation;
    if (node.mNumMeshes > 0) Add(node, place);
    for (unsigned i = 0; i < node.mNumChildren; ++i) Visit(*node.mChildren[i], place);
  }

  void Add(const aiNode& node, const aiMatrix4x4& place) {
    std::vector<Eigen::Vector3d> vertices;
    std::vector<PartMesh::Triangle> triangles;
    const bool mirrored = place.Determinant() < 0;
    for (unsigned m = 0; m < node.mNumMeshes; ++m) {
      const aiMesh& mesh = *scene_.mMeshes[node.mMeshes[m]];
      const auto first = static_cast<int>(vertices.size());
      for (unsigned v = 0; v < mesh.mNumVertices; ++v) {
        const aiVector3D p = place * mesh.mVertices[v];
        vertices.emplace_back(turn_ * Eigen::Vector3d(p.x, p.y, p.z));
      }
      for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
        const aiFace& face = mesh.mFaces[f];
        if (face.mNumIndices != 3) continue;  // points and lines
        PartMesh::Triangle triangle;
        for (unsigned k = 0; k < 3; ++k) triangle[k] = first + static_cast<int>(face.mIndices[k]);
        if (mirrored) std::swap(triangle[1], triangle[2]);
        triangles.push_back(triangle);
      }
    }
    if (triangles.empty()) return;
    if (parts_.size() == kMostParts)
      throw DataError(fmt::format("more than {} nodes have a mesh: join some", kMostParts));
    const std::string name = NameOf(node.mName, name_, &names_);
    try {
      parts_.push_back(
          Box::FromMesh(name, PartMesh::Make(std::move(vertices), std::move(triangles))));
    } catch (const DataError& error) {
      throw DataError(fmt::format("part '{}': {}", Shortened(name), error.what()));
    }
  }

  const aiScene& scene_;
  Eigen::Matrix3d turn_;
  std::string name_;
  std::set<std::string> names_;
  std::vector<Box> parts_;
};

}  // namespace

bool IsMeshFile(const std::filesystem::path& path) {
  return std::find(kEndings.begin(), kEndings.end(), EndingOf(path)) != kEndings.end();
}

std::vector<Box> ReadMeshParts(const std::filesystem::path& path, const MeshUnits& units) {
  const std::string ending = EndingOf(path);
  if (!IsMeshFile(path)) throw DataError("a mesh is a .glb, .gltf, .obj, .stl or .ply file");
  const std::string bytes = ReadFile(path.string(), kMaxResultBytes);
  if (ending == ".gltf" || ending == ".glb") RequireShallow(bytes);
  if (ending == ".ply") RequirePromised(bytes);
  Assimp::Importer importer;
  importer.SetIOHandler(new OnlyBeside(path));  // which it owns
  importer.SetPropertyInteger(
      AI_CONFIG_PP_RVC_FLAGS,
      aiComponent_NORMALS | aiComponent_TANGENTS_AND_BITANGENTS | aiComponent_COLORS |
          aiComponent_TEXCOORDS | aiComponent_BONEWEIGHTS | aiComponent_ANIMATIONS |
          aiComponent_TEXTURES | aiComponent_LIGHTS | aiComponent_CAMERAS | aiComponent_MATERIALS);
  const aiScene* scene =
      importer.ReadFile(path.string(), aiProcess_Triangulate | aiProcess_RemoveComponent |
                                           aiProcess_ValidateDataStructure);
  if (!scene || !scene->mRootNode) {
    throw DataError(
        fmt::format("it cannot be read as {}: {}", ending, Shortened(importer.GetErrorString())));
  }
  MeshUp up = units.up;
  if (up == MeshUp::kFormat) up = ending == ".stl" || ending == ".ply" ? MeshUp::kZ : MeshUp::kY;
  std::vector<Box> parts =
      Reader(*scene, units.scale * UpwardsFrom(up), path.stem().string()).Take();
  if (parts.empty()) throw DataError("it has no triangles");
  Eigen::AlignedBox3d bounds;
  for (const Box& part : parts)
    for (const Eigen::Vector3d& corner : part.Corners()) bounds.extend(corner);
  const double size = bounds.sizes().maxCoeff();
  if (size < kSmallest || size > kLargest) {
    throw DataError(fmt::format(
        "it is {:g} m long, and has to be from 5 cm to 50 m. Check the unit: `volalign structure "
        "build {} --mesh-scale 0.001 -o NAME.yaml` reads millimetres",
        size, ShownPath(path)));
  }
  return parts;
}

}  // namespace volalign

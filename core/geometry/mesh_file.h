#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/geometry/structure.h"

namespace volalign {

/// Which axis of a file points up. `format`: as the format has it, y in glTF and OBJ, z in STL and
/// PLY.
enum class MeshUp { kFormat, kX, kY, kZ };
constexpr Words<MeshUp, 4> WordsOf(MeshUp) {
  return {{{"format", MeshUp::kFormat}, {"x", MeshUp::kX}, {"y", MeshUp::kY}, {"z", MeshUp::kZ}}};
}

/// Is it a mesh by its ending: .glb, .gltf, .obj, .stl or .ply?
bool IsMeshFile(const std::filesystem::path& path);

/// The parts of a mesh (Assimp), y up. Each node that has a mesh is a part. `scale`: metres per
/// unit of the file; glTF has metres. Throws IoError, or DataError for what PartMesh refuses, and
/// for a mesh that is smaller than 5 cm or larger than 50 m.
std::vector<Box> ReadMeshParts(const std::filesystem::path& path, double scale = 1,
                               MeshUp up = MeshUp::kFormat);

}  // namespace volalign

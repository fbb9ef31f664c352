#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/geometry/structure.h"

namespace volalign {

/// Is it a mesh by its ending: .glb, .gltf, .obj, .stl or .ply?
bool IsMeshFile(const std::filesystem::path& path);

/// The parts of a mesh (Assimp), y up. Each node that has a mesh is a part. Throws IoError, or
/// DataError for what PartMesh refuses, and for a mesh that is smaller than 5 cm or larger than
/// 50 m.
std::vector<Box> ReadMeshParts(const std::filesystem::path& path, const MeshUnits& units = {});

}  // namespace volalign

#pragma once

#include <filesystem>

#include "core/geometry/structure.h"

namespace volalign {

/// Writes glTF 2.0 binary with the nodes of AddBoxes (gltf_parts.h), in the structure frame. Throws
/// IoError.
void WriteStructureGlb(const std::filesystem::path& path, const Structure& structure);

}  // namespace volalign

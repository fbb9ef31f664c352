#pragma once

#include <filesystem>

#include "core/geometry/structure.h"

namespace volalign {

/// Writes glTF 2.0 binary: one named node a box (its transform is structure_from_box, metres, y
/// up), one primitive a side with extras {side, label, centre, exposed_centroid} (structure frame).
/// Throws IoError.
void WriteStructureGlb(const std::filesystem::path& path, const Structure& structure);

}  // namespace volalign

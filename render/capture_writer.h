#pragma once

#include <cstdint>
#include <filesystem>

#include "render/rig.h"
#include "render/sample.h"

namespace volalign {

/// Writes a capture folder (design section 9): capture.json with ground truth (left out without a
/// structure), structure.glb and, per sensor, NAME_Depth.png (16 bits, mm) and NAME_labels.png (8
/// bits, what the noise left); contact_sheet.png shows clean depth, depth and labels of every
/// sensor, turned upright. Throws IoError.
void WriteCapture(const std::filesystem::path& dir, const RigCapture& capture);

/// Draws samples first_index, ..., first_index + count - 1 and writes for each NNNNNNNN_depth.png
/// (16 bits, mm) and NNNNNNNN_labels.png, an index.json ("volalign.samples/1": sensor, intrinsics,
/// pose, box offsets) and contact_sheet.png with the first 24. Throws IoError.
void WriteSamples(const std::filesystem::path& dir, const SampleContext& context,
                  DepthRenderer& renderer, std::uint64_t seed, std::uint64_t first_index,
                  int count);

}  // namespace volalign

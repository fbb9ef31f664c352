#pragma once

#include <filesystem>

namespace volalign {

/// Writes a checkpoint's tensors (core/nn/checkpoint.h) as safetensors: the header's length, 8
/// bytes, little-endian; the header, JSON, of each tensor `dtype` (F32, F16), `shape` and
/// `data_offsets`; the values. Its `__metadata__`, texts, are `format`, `volalign.json`
/// (MetaToJson), `orientation` and `structure_sha256`. With `half`, parameters are F16. The same
/// checkpoint gives the same bytes. Throws IoError or DataError.
void ExportSafetensors(const std::filesystem::path& checkpoint, const std::filesystem::path& output,
                       bool half);

}  // namespace volalign

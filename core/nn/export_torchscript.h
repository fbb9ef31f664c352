#pragma once

#include <filesystem>

namespace volalign {

/// Writes a checkpoint (core/nn/checkpoint.h) as self-contained TorchScript: `torch.jit.load` in
/// Python or C++ runs it without volalign. Its forward takes depth [B,1,H,W] float32, metres, 0
/// without depth, any H, W >= 16, and includes the input encoding. It returns the log-probabilities
/// [B,K,H,W] float32 of StructureNet in evaluation mode. The checkpoint's metadata (structure,
/// labels, focal lengths) is the archive's extra file `volalign.json`. With `half`, parameters are
/// stored as float16 and widened in forward: everything is computed in float32. Throws IoError,
/// DataError, or ConfigError for a network of another kind than the paper's.
void ExportTorchScript(const std::filesystem::path& checkpoint, const std::filesystem::path& output,
                       bool half = false);

}  // namespace volalign

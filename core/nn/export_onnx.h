#pragma once

#include <filesystem>

namespace volalign {

/// Writes a checkpoint (core/nn/checkpoint.h) as ONNX (core/model/onnx_graph.h) of opset 13, with
/// the input encoding and the metadata. It takes depth in metres and gives log-probabilities, for
/// any size and batch. With `half`, parameters are stored as float16 and widened by Cast nodes:
/// everything is computed in float32. The same checkpoint gives the same bytes. Throws IoError,
/// DataError, ConfigError for a network of another kind than the paper's, or Error for more than
/// the 2 GiB of Protocol Buffers.
void ExportOnnx(const std::filesystem::path& checkpoint, const std::filesystem::path& output,
                bool half);

}  // namespace volalign

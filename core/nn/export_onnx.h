#pragma once

#include <filesystem>

namespace volalign {

/// Writes a checkpoint (core/nn/checkpoint.h) as ONNX (core/model/onnx_graph.h): opset 13, depth in
/// metres in, log-probabilities out, any size and batch, the input encoding and the metadata
/// within. With `half`, parameters are stored as float16 and widened by Cast nodes: everything is
/// computed in float32. The same checkpoint gives the same bytes. Throws IoError, DataError,
/// ConfigError for a network of another kind than the paper's, or Error for more than the 2 GiB
/// that Protocol Buffers hold.
void ExportOnnx(const std::filesystem::path& checkpoint, const std::filesystem::path& output,
                bool half);

}  // namespace volalign

#pragma once

#include <onnx/onnx_pb.h>

#include <string_view>

#include "core/model/checkpoint_meta.h"

namespace volalign {

/// An ONNX file of ours, checked.
struct OnnxNetwork {
  CheckpointMeta meta;
  /// Takes the encoded depth, has parameters as float32, and nothing to cast.
  onnx::ModelProto model;
};

/// Reads the bytes of a file that ExportOnnx (core/nn/export_onnx.h) wrote. Its graph has to be the
/// one that its metadata describes, node by node, and its tensors those of that network, so that
/// nothing else gets to a library that runs graphs. Memory is a small multiple of the file's size.
/// Throws DataError, with what is wrong but without the file's name, for anything else.
OnnxNetwork ReadOnnxNetwork(std::string_view bytes);

}  // namespace volalign

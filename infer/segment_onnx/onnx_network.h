#pragma once

#include <onnx/onnx_pb.h>

#include <string_view>

#include "core/model/checkpoint_meta.h"

namespace volalign {

/// A verified ONNX file of volalign.
struct OnnxNetwork {
  CheckpointMeta meta;
  /// Its input is the encoded depth, and its parameters are float32, with nothing to cast.
  onnx::ModelProto model;
};

/// Reads the bytes of a file that ExportOnnx (core/nn/export_onnx.h) wrote. Its graph has to be the
/// one that its metadata describes, node by node, with that network's tensors. Nothing else thus
/// gets to a library that runs graphs. Memory is a small multiple of the file's size. Throws
/// DataError for anything else, with the reason but without the file's name.
OnnxNetwork ReadOnnxNetwork(std::string_view bytes);

}  // namespace volalign

#pragma once

#include <onnx/onnx_pb.h>

#include <string>

#include "core/model/network_options.h"

namespace volalign {

/// An ONNX file of a network. The graph takes kOnnxDepth, [B,1,H,W] float32, metres, 0 without
/// depth, any H, W >= 16. It gives kOnnxLogProbabilities, [B,K,H,W] float32. The tensor
/// kOnnxEncoded within it is the encoded depth [B,C,H,W] (EncodedChannels): a caller who encodes
/// depth himself may cut the graph there. Weights have the names of the checkpoint's tensors.
/// metadata_props has the five texts that follow.
inline constexpr char kOnnxDepth[] = "depth";
inline constexpr char kOnnxEncoded[] = "encoded";
inline constexpr char kOnnxLogProbabilities[] = "log_probabilities";

inline constexpr char kOnnxFormatKey[] = "format";
inline constexpr char kOnnxFormat[] = "volalign.onnx/1";      ///< another graph is another format
inline constexpr char kOnnxMetaKey[] = "volalign.json";       ///< MetaToJson (checkpoint_meta.h)
inline constexpr char kOnnxOrientationKey[] = "orientation";  ///< OrientationOf
inline constexpr char kOnnxStructureKey[] = "structure_sha256";  ///< Structure::Hash()
inline constexpr char kOnnxDigestKey[] = "digest";               ///< OnnxDigest

/// The paper's network as a graph of opset 13 without the weights. With `half`, parameters are
/// stored as float16 and cast to float32, in which everything is computed. Throws ConfigError for
/// invalid options.
onnx::GraphProto PaperNetGraph(const StructureNetOptions& options, bool half);

/// The opset of PaperNetGraph.
inline constexpr int kOnnxOpset = 13;

/// Is a tensor of the network (PaperNetShapes) stored as float16 in half precision? So are
/// parameters, but not running statistics.
bool IsHalfTensor(const std::string& name);

/// SHA-256 of the model without its digest. A flipped bit is then an error and not a bad pose.
std::string OnnxDigest(const onnx::ModelProto& model);

}  // namespace volalign

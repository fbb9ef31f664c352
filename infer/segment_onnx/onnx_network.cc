#include "infer/segment_onnx/onnx_network.h"

#include <fmt/format.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>

#include <functional>
#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/model/onnx_graph.h"
#include "core/model/paper_units.h"

namespace volalign {
namespace {

// A message of two bytes takes a hundred in memory. The largest network of network_options.h has 7
// nodes per residual block and 340 others, and fewer tensors.
constexpr int kMostFields = 2000;
/// A node, or a text other than the metadata, has some hundred bytes.
constexpr std::size_t kMostNodeBytes = 4096;

[[noreturn]] void Fail(const std::string& why) { throw DataError(why); }

/// Calls `use` with number and bytes of each field of a message that has a length; the others are
/// numbers.
void ForEachField(std::string_view message,
                  const std::function<void(int number, std::string_view bytes)>& use) {
  using google::protobuf::internal::WireFormatLite;
  google::protobuf::io::CodedInputStream stream(
      reinterpret_cast<const std::uint8_t*>(message.data()), static_cast<int>(message.size()));
  for (int count = 0;; ++count) {
    const std::uint32_t tag = stream.ReadTag();
    if (tag == 0) break;
    if (count == kMostFields) Fail("it has too many parts");
    if (WireFormatLite::GetTagWireType(tag) != WireFormatLite::WIRETYPE_LENGTH_DELIMITED) {
      if (!WireFormatLite::SkipField(&stream, tag)) Fail("it is truncated");
      continue;
    }
    std::uint32_t size = 0;
    if (!stream.ReadVarint32(&size)) Fail("it is truncated");
    const auto at = static_cast<std::size_t>(stream.CurrentPosition());
    if (size > message.size() - at) Fail("it is truncated");
    use(WireFormatLite::GetTagFieldNumber(tag), message.substr(at, size));
    stream.Skip(static_cast<int>(size));
  }
  if (static_cast<std::size_t>(stream.CurrentPosition()) != message.size()) Fail("it is truncated");
}

/// Throws DataError if parsing would take far more memory than the bytes have.
void RequireFewParts(std::string_view bytes) {
  ForEachField(bytes, [](int number, std::string_view part) {
    if (number != onnx::ModelProto::kGraphFieldNumber) return;
    ForEachField(part, [](int in_graph, std::string_view inner) {
      if (in_graph == onnx::GraphProto::kInitializerFieldNumber) {
        ForEachField(inner, [](int, std::string_view) {});
      } else if (inner.size() > kMostNodeBytes) {
        Fail("it has too large a node");
      }
    });
  });
}

std::map<std::string, std::string> TextsOf(const onnx::ModelProto& model) {
  std::map<std::string, std::string> texts;
  for (const onnx::StringStringEntryProto& entry : model.metadata_props())
    texts.emplace(entry.key(), entry.value());
  return texts;
}

/// Takes the network's tensors out of the graph, by their names, which they lose.
std::map<std::string, onnx::TensorProto> TakeWeights(const TensorShapes& shapes,
                                                     onnx::GraphProto* graph) {
  std::map<std::string, onnx::TensorProto> weights;
  onnx::GraphProto rest;
  for (onnx::TensorProto& tensor : *graph->mutable_initializer()) {
    if (shapes.count(tensor.name()) == 0) {
      *rest.add_initializer() = std::move(tensor);
    } else if (!weights.emplace(tensor.name(), std::move(tensor)).second) {
      Fail("it has two tensors of one name");
    }
  }
  graph->mutable_initializer()->Swap(rest.mutable_initializer());
  return weights;
}

/// The tensor as float32. Throws DataError unless it has this shape and type.
onnx::TensorProto Widened(onnx::TensorProto tensor, const std::vector<std::int64_t>& shape,
                          bool half) {
  std::size_t count = 1;
  for (const std::int64_t size : shape) count *= static_cast<std::size_t>(size);
  const std::vector<std::int64_t> dims(tensor.dims().begin(), tensor.dims().end());
  const onnx::TensorProto::DataType type =
      half ? onnx::TensorProto::FLOAT16 : onnx::TensorProto::FLOAT;
  if (dims != shape || tensor.data_type() != type ||
      tensor.raw_data().size() != count * (half ? 2 : 4)) {
    Fail(fmt::format("its tensor '{}' is not one of {}, [{}]", tensor.name(),
                     half ? "float16" : "float32", fmt::join(shape, ",")));
  }
  if (!half) return tensor;
  const cv::Mat narrow(1, static_cast<int>(count), CV_16F,
                       const_cast<char*>(tensor.raw_data().data()));
  cv::Mat wide;
  narrow.convertTo(wide, CV_32F);
  tensor.set_raw_data(wide.data, count * sizeof(float));
  tensor.set_data_type(onnx::TensorProto::FLOAT);
  return tensor;
}

/// Removes the nodes that encode depth, which come first. It also removes those that widen weights;
/// the weights take the place of their results.
void CutAtEncoded(const StructureNetOptions& options, const TensorShapes& shapes,
                  std::map<std::string, onnx::TensorProto> weights, bool half,
                  onnx::GraphProto* graph) {
  onnx::GraphProto cut;
  bool encoded = false;
  for (onnx::NodeProto& node : *graph->mutable_node()) {
    const std::string& result = node.output(0);
    if (encoded && node.op_type() == "Cast") {
      weights.at(node.input(0)).set_name(result);
    } else if (encoded) {
      *cut.add_node() = std::move(node);
    } else {
      encoded = result == kOnnxEncoded;
    }
  }
  graph->mutable_node()->Swap(cut.mutable_node());
  for (auto& [name, tensor] : weights) {
    *graph->add_initializer() =
        Widened(std::move(tensor), shapes.at(name), half && IsHalfTensor(name));
  }
  onnx::ValueInfoProto* input = graph->mutable_input(0);
  input->set_name(kOnnxEncoded);
  input->mutable_type()->mutable_tensor_type()->mutable_shape()->mutable_dim(1)->set_dim_value(
      EncodedChannels(options.input));
}

}  // namespace

OnnxNetwork ReadOnnxNetwork(std::string_view bytes) {
  RequireFewParts(bytes);
  OnnxNetwork network;
  if (!network.model.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
    Fail("it is truncated or no ONNX");
  std::map<std::string, std::string> texts = TextsOf(network.model);
  if (texts[kOnnxFormatKey] != kOnnxFormat)
    Fail(fmt::format("its format is '{}'", Shortened(texts[kOnnxFormatKey])));
  if (texts[kOnnxDigestKey] != OnnxDigest(network.model))
    Fail("its digest does not match: the content was changed");
  try {
    network.meta = MetaFromJson(texts[kOnnxMetaKey]);
    RequirePaperNet(network.meta, kOnnxMetaKey);
  } catch (const Error& error) {
    Fail(fmt::format("invalid metadata ({})", Shortened(error.what())));
  }
  const TensorShapes shapes = PaperNetShapes(network.meta.network);
  onnx::GraphProto* graph = network.model.mutable_graph();
  std::map<std::string, onnx::TensorProto> weights = TakeWeights(shapes, graph);
  if (weights.size() != shapes.size()) Fail("it lacks tensors of its network");
  const bool half = weights.at("classifier.weight").data_type() == onnx::TensorProto::FLOAT16;
  if (graph->SerializeAsString() != PaperNetGraph(network.meta.network, half).SerializeAsString()) {
    Fail("its graph is not the one of its metadata");
  }
  CutAtEncoded(network.meta.network, shapes, std::move(weights), half, graph);
  return network;
}

}  // namespace volalign

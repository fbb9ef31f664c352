#include "core/model/onnx_graph.h"

#include <fmt/format.h>

#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/model/paper_units.h"

namespace volalign {
namespace {

onnx::AttributeProto* NewAttribute(onnx::NodeProto* node, const char* name,
                                   onnx::AttributeProto::AttributeType type) {
  onnx::AttributeProto* attribute = node->add_attribute();
  attribute->set_name(name);
  attribute->set_type(type);
  return attribute;
}
void SetAttribute(onnx::NodeProto* node, const char* name, std::int64_t value) {
  NewAttribute(node, name, onnx::AttributeProto::INT)->set_i(value);
}
void SetAttribute(onnx::NodeProto* node, const char* name, double value) {
  NewAttribute(node, name, onnx::AttributeProto::FLOAT)->set_f(static_cast<float>(value));
}
void SetAttribute(onnx::NodeProto* node, const char* name, const char* value) {
  NewAttribute(node, name, onnx::AttributeProto::STRING)->set_s(value);
}
void SetAttribute(onnx::NodeProto* node, const char* name,
                  const std::vector<std::int64_t>& values) {
  onnx::AttributeProto* attribute = NewAttribute(node, name, onnx::AttributeProto::INTS);
  for (const std::int64_t value : values) attribute->add_ints(value);
}

void Describe(onnx::ValueInfoProto* value, const char* name, const char* channels, int count,
              const char* what) {
  value->set_name(name);
  value->set_doc_string(what);
  onnx::TypeProto::Tensor* tensor = value->mutable_type()->mutable_tensor_type();
  tensor->set_elem_type(onnx::TensorProto::FLOAT);
  for (const char* dimension : {"batch", channels, "height", "width"}) {
    onnx::TensorShapeProto::Dimension* dim = tensor->mutable_shape()->add_dim();
    if (dimension == channels) {
      dim->set_dim_value(count);
    } else {
      dim->set_dim_param(dimension);
    }
  }
}

/// Writes MakePaperNet as nodes of ONNX. A value is the name of a result.
class GraphWriter {
 public:
  using Value = std::string;

  GraphWriter(const StructureNetOptions& options, bool half) : options_(options), half_(half) {
    options.Validate();
  }

  onnx::GraphProto Write() {
    graph_.set_name("StructureNet");
    Describe(graph_.add_input(), kOnnxDepth, "one", 1, "depth, m, 0 where there is none");
    Describe(graph_.add_output(), kOnnxLogProbabilities, "classes", options_.num_classes,
             "log-probabilities of background and of the labels 1, 2, ...");
    const std::string logits = MakePaperNet(options_, *this, Encode());
    Node("LogSoftmax", kOnnxLogProbabilities, {logits});
    SetAttribute(node_, "axis", std::int64_t{1});
    return std::move(graph_);
  }

  std::string Op(PaperOp op, const std::string& name, const std::string& x,
                 const std::string& y = "") {
    switch (op) {
      case PaperOp::kRelu:
        return Node("Relu", name, {x});
      case PaperOp::kPool:
        Node("MaxPool", name, {x});
        SetAttribute(node_, "kernel_shape", {2, 2});
        SetAttribute(node_, "strides", {2, 2});
        return name;
      case PaperOp::kSigmoid:
        return Node("Sigmoid", name, {x});
      case PaperOp::kAdd:
        return Node("Add", name, {x, y});
      case PaperOp::kMultiply:
        return Node("Mul", name, {x, y});
      case PaperOp::kConcatenate:
        return Concat(name, x, y, 1);
      case PaperOp::kSizeOf:
        return Slice(name, x, 2, 4);
      case PaperOp::kEnlarge:
        return Upsample(name, x, y);
    }
    throw Error("invalid PaperOp");
  }

  std::string UnitOfEnlarged(const PaperUnit& unit, const std::string& name, const std::string& x,
                             const std::string& size) {
    return Unit(unit, Upsample(name, x, size));
  }

  std::string Unit(const PaperUnit& unit, const std::string& x) {
    const std::string& name = unit.name;
    std::vector<std::string> inputs = {x, Weight(name + ".weight")};
    if (unit.normalization == Normalization::kNone) inputs.push_back(Weight(name + ".bias"));
    const std::int64_t padding = unit.kernel / 2;
    std::string y = Node("Conv", name + ".conv", inputs);
    SetAttribute(node_, "kernel_shape", {unit.kernel, unit.kernel});
    SetAttribute(node_, "pads", {padding, padding, padding, padding});
    if (unit.normalization == Normalization::kBatch) {
      const std::string scale = Weight(name + ".norm_weight"), shift = Weight(name + ".norm_bias");
      y = Node("BatchNormalization", name + ".norm",
               {y, scale, shift, Weight(name + ".running_mean"), Weight(name + ".running_var")});
      SetAttribute(node_, "epsilon", kNormEpsilon);
    } else if (unit.normalization == Normalization::kGroup) {
      y = GroupNormalized(unit, y);
    }
    return unit.relu ? Node("Relu", name + ".relu", {y}) : y;
  }

 private:
  /// Adds a node. `node_` is the new one, for its attributes.
  std::string Node(const char* type, const std::string& result,
                   const std::vector<std::string>& inputs) {
    node_ = graph_.add_node();
    node_->set_op_type(type);
    node_->set_name(result);
    for (const std::string& input : inputs) node_->add_input(input);
    node_->add_output(result);
    return result;
  }

  std::string Encode() {
    if (options_.input == InputEncoding::kDepth)
      return Node("Identity", kOnnxEncoded, {kOnnxDepth});
    const std::string is_measured =
        Node("Greater", "is_measured", {kOnnxDepth, Number("nothing", 0)});
    const std::string measured = Node("Cast", "measured", {is_measured});
    SetAttribute(node_, "to", std::int64_t{onnx::TensorProto::FLOAT});
    const std::string clamped = Node("Min", "clamped", {kOnnxDepth, Number("clamp", kDepthClamp)});
    const std::string centred = Node("Sub", "centred", {clamped, Number("centre", kDepthCentre)});
    return Concat(kOnnxEncoded, Node("Mul", "masked", {centred, measured}), measured, 1);
  }

  /// Opset 13 has no such operator, but a normalisation of each channel alone. So a group becomes
  /// one channel.
  std::string GroupNormalized(const PaperUnit& unit, const std::string& x) {
    const std::int64_t groups = NormGroups(unit.out);
    const std::string& name = unit.name;
    const std::string grouped =
        Node("Reshape", name + ".grouped",
             {x, Constant<std::int64_t>(fmt::format("groups{}", groups), {0, groups, -1})});
    const auto ones = static_cast<std::size_t>(groups);
    const std::string normal =
        Node("InstanceNormalization", name + ".normal",
             {grouped, Constant(fmt::format("ones{}", groups), std::vector<float>(ones, 1)),
              Constant(fmt::format("zeros{}", groups), std::vector<float>(ones, 0))});
    SetAttribute(node_, "epsilon", kNormEpsilon);
    const std::string shape = Node("Shape", name + ".shape", {x});
    const std::string whole = Node("Reshape", name + ".whole", {normal, shape});
    const std::string channels = Constant<std::int64_t>("channels", {1, -1, 1, 1});
    const std::string scale =
        Node("Reshape", name + ".scale", {Weight(name + ".norm_weight"), channels});
    const std::string shift =
        Node("Reshape", name + ".shift", {Weight(name + ".norm_bias"), channels});
    return Node("Add", name + ".norm", {Node("Mul", name + ".scaled", {whole, scale}), shift});
  }

  std::string Weight(const std::string& name) {
    if (!half_ || !IsHalfTensor(name)) return name;
    std::string wide = Node("Cast", name + ".float32", {name});
    SetAttribute(node_, "to", std::int64_t{onnx::TensorProto::FLOAT});
    return wide;
  }

  std::string Concat(const std::string& name, const std::string& a, const std::string& b,
                     std::int64_t axis) {
    Node("Concat", name, {a, b});
    SetAttribute(node_, "axis", axis);
    return name;
  }

  /// Sizes begin to end - 1 of x.
  std::string Slice(const std::string& name, const std::string& x, std::int64_t begin,
                    std::int64_t end) {
    const std::string shape = Node("Shape", name + ".shape", {x});
    return Node("Slice", name,
                {shape, Constant<std::int64_t>(fmt::format("at{}", begin), {begin}),
                 Constant<std::int64_t>(fmt::format("at{}", end), {end}),
                 Constant<std::int64_t>("at0", {0})});
  }

  /// As at::upsample_nearest2d: pixel i takes floor(i * size / new_size).
  std::string Upsample(const std::string& name, const std::string& x, const std::string& size) {
    const std::string batch = Slice(name + ".batch", x, 0, 2);
    const std::string sizes = Concat(name + ".sizes", batch, size, 0);
    Node("Resize", name, {x, "", "", sizes});
    SetAttribute(node_, "coordinate_transformation_mode", "asymmetric");
    SetAttribute(node_, "mode", "nearest");
    SetAttribute(node_, "nearest_mode", "floor");
    return name;
  }

  /// A list of float or std::int64_t, or its only number. Adds it unless there is one of that name.
  template <class T>
  std::string Constant(const std::string& name, const std::vector<T>& values,
                       bool is_number = false) {
    for (const onnx::TensorProto& known : graph_.initializer()) {
      if (known.name() == name) return name;
    }
    onnx::TensorProto* tensor = graph_.add_initializer();
    tensor->set_name(name);
    tensor->set_data_type(std::is_same_v<T, float> ? onnx::TensorProto::FLOAT
                                                   : onnx::TensorProto::INT64);
    if (!is_number) tensor->add_dims(static_cast<std::int64_t>(values.size()));
    for (const T value : values) {
      if constexpr (std::is_same_v<T, float>) {
        tensor->add_float_data(value);
      } else {
        tensor->add_int64_data(value);
      }
    }
    return name;
  }
  std::string Number(const std::string& name, double value) {
    return Constant<float>(name, {static_cast<float>(value)}, /*is_number=*/true);
  }

  const StructureNetOptions& options_;
  const bool half_;
  onnx::GraphProto graph_;
  onnx::NodeProto* node_ = nullptr;
};

}  // namespace

onnx::GraphProto PaperNetGraph(const StructureNetOptions& options, bool half) {
  return GraphWriter(options, half).Write();
}

bool IsHalfTensor(const std::string& name) { return name.find(".running_") == std::string::npos; }

std::string OnnxDigest(const onnx::ModelProto& model) {
  onnx::ModelProto plain = model;
  plain.clear_metadata_props();
  for (const onnx::StringStringEntryProto& entry : model.metadata_props()) {
    if (entry.key() != kOnnxDigestKey) *plain.add_metadata_props() = entry;
  }
  return Sha256(plain.SerializeAsString());
}

}  // namespace volalign

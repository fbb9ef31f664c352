#include "infer/segment_onnx/onnx_network.h"

#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "core/base/random.h"
#include "core/model/onnx_graph.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/long_tests.h"
#include "tests/core/base/read_file.h"

namespace volalign::onnx_network_test {
namespace {

class OnnxNetworkTest : public ::testing::Test {
 protected:
  const std::string bytes_ = ReadFile("models/m05-lite.onnx");

  /// The file with a change, and a digest that fits, as somebody would write it who means harm.
  std::string Altered(const std::function<void(onnx::ModelProto*)>& change) const {
    onnx::ModelProto model;
    EXPECT_TRUE(model.ParseFromString(bytes_));
    change(&model);
    const std::string digest = OnnxDigest(model);
    for (onnx::StringStringEntryProto& entry : *model.mutable_metadata_props()) {
      if (entry.key() == kOnnxDigestKey) entry.set_value(digest);
    }
    return model.SerializeAsString();
  }

  void ExpectRefused(const std::string& message,
                     const std::function<void(onnx::ModelProto*)>& change) const {
    const std::string altered = Altered(change);
    ExpectError<DataError>([&] { ReadOnnxNetwork(altered); }, {message});
  }

  static onnx::TensorProto* Tensor(onnx::ModelProto* model, const std::string& name) {
    for (onnx::TensorProto& tensor : *model->mutable_graph()->mutable_initializer()) {
      if (tensor.name() == name) return &tensor;
    }
    throw Error("no tensor " + name);
  }
};

TEST_F(OnnxNetworkTest, IsCutAtTheEncodedDepthAndWidened) {
  const OnnxNetwork network = ReadOnnxNetwork(bytes_);
  EXPECT_EQ(network.meta.structure.num_classes(), 21);
  EXPECT_EQ(network.meta.structure.Hash(), ReadStructure("configs/structure.yaml").Hash());
  const onnx::GraphProto& graph = network.model.graph();
  EXPECT_EQ(graph.input(0).name(), kOnnxEncoded);
  EXPECT_EQ(graph.input(0).type().tensor_type().shape().dim(1).dim_value(), 2);
  for (const onnx::NodeProto& node : graph.node()) {
    EXPECT_NE(node.op_type(), "Cast");
    EXPECT_NE(node.op_type(), "Greater");
  }
  for (const onnx::TensorProto& tensor : graph.initializer())
    EXPECT_NE(tensor.data_type(), onnx::TensorProto::FLOAT16) << tensor.name();
}

TEST_F(OnnxNetworkTest, RefusesDamagedFiles) {
  for (const std::size_t size : {0ul, 1ul, 10ul, 1000ul, bytes_.size() / 2, bytes_.size() - 1})
    ExpectError<DataError>([&] { ReadOnnxNetwork(bytes_.substr(0, size)); });
  RandomStream random(1, 0, "onnx_network_test");
  for (std::uint64_t i = 0; i < Rounds(40, 2000); ++i) {
    std::string changed = bytes_;
    // Every second one at the front, where the graph stands and not the weights.
    const int range = i % 2 == 0 ? static_cast<int>(bytes_.size()) : 20000;
    char& byte = changed[static_cast<std::size_t>(random.Below(range))];
    byte = static_cast<char>(byte ^ (1 << random.Below(8)));
    ExpectError<DataError>([&] { ReadOnnxNetwork(changed); });
  }
  // No protocol buffer at all; and one of ten million empty nodes, which parsed would take a
  // hundred times its size.
  ExpectError<DataError>([] { ReadOnnxNetwork(std::string(1000, '\xff')); });
  std::string many;
  const std::string nodes(20'000'000, '\x0a');  // NOLINT(bugprone-string-constructor)
  many.push_back(0x3a);                         // field 7, the graph
  for (std::size_t length = nodes.size(); length > 0; length >>= 7)
    many.push_back(static_cast<char>((length & 0x7f) | (length >> 7 ? 0x80 : 0)));
  std::string pairs = nodes;
  for (std::size_t i = 1; i < pairs.size(); i += 2) pairs[i] = 0;
  ExpectError<DataError>([&] { ReadOnnxNetwork(many + pairs); }, {"too many parts"});
}

TEST_F(OnnxNetworkTest, RefusesGraphsThatAreNotItsOwn) {
  ExpectRefused("graph",
                [](auto* model) { model->mutable_graph()->mutable_node(10)->set_op_type("Loop"); });
  ExpectRefused("graph", [](auto* model) {
    for (onnx::NodeProto& node : *model->mutable_graph()->mutable_node()) {
      for (onnx::AttributeProto& attribute : *node.mutable_attribute()) {
        if (attribute.name() == "pads") attribute.set_ints(0, 1 << 30);
      }
    }
  });
  ExpectRefused(
      "graph", [](auto* model) { model->mutable_graph()->add_initializer()->set_name("another"); });
  ExpectRefused("too many parts", [](auto* model) {
    for (int i = 0; i < 3000; ++i) model->mutable_graph()->add_node();
  });
}

TEST_F(OnnxNetworkTest, RefusesTensorsOfAnotherSize) {
  const std::string name = "encoder1_1.weight";
  ExpectRefused(name, [&](auto* model) { Tensor(model, name)->clear_raw_data(); });
  ExpectRefused(name, [&](auto* model) { Tensor(model, name)->set_dims(0, 1 << 30); });
  ExpectRefused(name, [&](auto* model) { Tensor(model, name)->set_dims(0, -1); });
  ExpectRefused(name,
                [&](auto* model) { Tensor(model, name)->set_data_type(onnx::TensorProto::INT64); });
  ExpectRefused(name, [&](auto* model) {
    Tensor(model, name)->clear_raw_data();
    Tensor(model, name)->set_data_location(onnx::TensorProto::EXTERNAL);
  });
  ExpectRefused("lacks", [&](auto* model) { Tensor(model, name)->set_name("other"); });
  ExpectRefused("two tensors", [&](auto* model) {
    *model->mutable_graph()->add_initializer() = *Tensor(model, name);
  });
}

TEST_F(OnnxNetworkTest, RefusesMetadataOfAnother) {
  const auto text = [](onnx::ModelProto* model, const std::string& key) -> std::string* {
    for (onnx::StringStringEntryProto& entry : *model->mutable_metadata_props()) {
      if (entry.key() == key) return entry.mutable_value();
    }
    throw Error("no text " + key);
  };
  ExpectRefused("metadata", [&](auto* model) { *text(model, kOnnxMetaKey) = "{"; });
  ExpectRefused("other/1", [&](auto* model) { *text(model, kOnnxFormatKey) = "other/1"; });
  ExpectRefused("format", [&](auto* model) { model->clear_metadata_props(); });
  ExpectRefused("attention.weight", [&](auto* model) {
    std::string* meta = text(model, kOnnxMetaKey);
    const std::string key = "\"base_channels\": ";
    meta->insert(meta->find(key) + key.size(), "1");
  });
}

}  // namespace
}  // namespace volalign::onnx_network_test

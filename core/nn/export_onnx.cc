#include "core/nn/export_onnx.h"

#include <ATen/core/Tensor.h>
#include <fmt/format.h>

#include <string>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/model/onnx_graph.h"
#include "core/nn/checkpoint.h"

namespace volalign {
namespace {

/// The version of ONNX's own format that came with kOnnxOpset.
constexpr int kIrVersion = 7;

void AddText(onnx::ModelProto* model, const char* key, const std::string& value) {
  onnx::StringStringEntryProto* entry = model->add_metadata_props();
  entry->set_key(key);
  entry->set_value(value);
}

}  // namespace

void ExportOnnx(const std::filesystem::path& checkpoint, const std::filesystem::path& output,
                bool half) {
  const LoadedModel loaded = LoadCheckpoint(checkpoint);
  RequirePaperNet(loaded.meta, checkpoint.string());
  onnx::ModelProto model;
  model.set_ir_version(kIrVersion);
  model.set_producer_name("volalign");
  model.add_opset_import()->set_version(kOnnxOpset);
  *model.mutable_graph() = PaperNetGraph(loaded.meta.network, half);
  for (const auto& [name, tensor] : NetworkTensors(loaded.net, half, checkpoint.string())) {
    const at::Tensor plain = tensor.detach().contiguous();
    onnx::TensorProto* stored = model.mutable_graph()->add_initializer();
    stored->set_name(name);
    stored->set_data_type(plain.scalar_type() == at::kHalf ? onnx::TensorProto::FLOAT16
                                                           : onnx::TensorProto::FLOAT);
    for (const std::int64_t size : plain.sizes()) stored->add_dims(size);
    stored->set_raw_data(plain.data_ptr(), plain.nbytes());
  }
  AddText(&model, kOnnxFormatKey, kOnnxFormat);
  AddText(&model, kOnnxMetaKey, MetaToJson(loaded.meta));
  AddText(&model, kOnnxOrientationKey, OrientationOf(loaded.meta));
  AddText(&model, kOnnxStructureKey, loaded.meta.structure.Hash());
  AddText(&model, kOnnxDigestKey, OnnxDigest(model));
  std::string bytes;
  if (!model.SerializeToString(&bytes)) {
    throw Error(
        fmt::format("{}: more than the 2 GiB that ONNX holds: export it as float16, or use "
                    "fewer base channels",
                    output.string()));
  }
  WriteFileAtomically(output, bytes);
}

}  // namespace volalign

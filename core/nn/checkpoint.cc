#include "core/nn/checkpoint.h"

#include <ATen/ops/isfinite.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>
#include <torch/version.h>

#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/base/provenance.h"
#include "core/base/text.h"
#include "core/model/paper_units.h"
#include "core/nn/safetensors.h"

namespace volalign {
namespace {

// Texts of the header.
constexpr char kFormat[] = "format", kMeta[] = "volalign.json", kDigest[] = "digest";

std::string Digest(const TensorFile& file) {
  std::string hashes = file.meta;
  for (const auto& [name, tensor] : file.tensors) {
    const std::string_view bytes(static_cast<const char*>(tensor.data_ptr()), tensor.nbytes());
    hashes +=
        fmt::format("\n{} {} {} {}", name, at::toString(tensor.scalar_type()),
                    fmt::join(tensor.sizes().begin(), tensor.sizes().end(), ","), Sha256(bytes));
  }
  return Sha256(hashes);
}

/// Throws DataError unless the tensors whose names begin with `prefix` are those of `shapes`.
void RequireShapes(const std::map<std::string, at::Tensor>& tensors, const std::string& prefix,
                   const TensorShapes& shapes, const std::string& what) {
  for (const auto& [name, tensor] : tensors) {
    if (name.compare(0, prefix.size(), prefix) == 0 && shapes.count(name) == 0) {
      throw DataError(fmt::format("{}: tensor '{}' is not the network's", what, Shortened(name)));
    }
  }
  for (const auto& [name, shape] : shapes) {
    const auto found = tensors.find(name);
    if (found == tensors.end()) {
      throw DataError(fmt::format("{}: tensor '{}' is missing", what, name));
    }
    const auto sizes = found->second.sizes();
    if (sizes != shape) {
      throw DataError(fmt::format("{}: tensor '{}' has the shape [{}] instead of [{}]", what, name,
                                  fmt::join(sizes.begin(), sizes.end(), ","),
                                  fmt::join(shape, ",")));
    }
  }
}

}  // namespace

void WriteTensorFile(const std::filesystem::path& path, const TensorFile& file) {
  TensorFile stored{file.format, file.meta, {}};
  for (const auto& [name, tensor] : file.tensors)
    stored.tensors.emplace(name, tensor.detach().to(at::kCPU).contiguous());
  const std::string bytes =
      WriteSafetensors({{{kFormat, stored.format}, {kMeta, stored.meta}, {kDigest, Digest(stored)}},
                        stored.tensors});
  if (bytes.size() > kMaxModelBytes) {
    throw Error(fmt::format(
        "{}: {} bytes are more than the {} that are read of such a file: use fewer base channels",
        path.string(), bytes.size(), kMaxModelBytes));
  }
  WriteFileAtomically(path, bytes);
}

TensorFile ReadTensorFile(const std::filesystem::path& path, const std::string& format) {
  const std::string content = ReadFile(FindInputFile(path.string()), kMaxModelBytes);
  if (content.compare(0, 2, "PK") == 0) {
    throw DataError(
        fmt::format("{} is a zip archive, as earlier versions of volalign wrote checkpoints and "
                    "states: convert it with packaging/convert_checkpoint.py {} OUTPUT",
                    path.string(), path.string()));
  }
  const auto foreign = [&](const std::string& why) {
    const bool checkpoint = format == kCheckpointFormat;
    return DataError(fmt::format(
        "{} is not a {}, or not a whole one: {}", path.string(),
        checkpoint ? "volalign checkpoint (.safetensors)" : "file of format " + format, why));
  };
  TensorFile file;
  try {
    Safetensors stored = ReadSafetensors(content);
    const auto text = [&](const char* key) -> std::string {
      const auto found = stored.texts.find(key);
      if (found == stored.texts.end()) throw DataError(fmt::format("it has no {}", key));
      return found->second;
    };
    file = {text(kFormat), text(kMeta), std::move(stored.tensors)};
    if (file.format != format)
      throw DataError(fmt::format("its format is '{}'", Shortened(file.format)));
    if (Digest(file) != text(kDigest))
      throw DataError("its digest does not match: the content was changed");
  } catch (const DataError& error) {
    throw foreign(error.what());
  }
  return file;
}

void AddModuleTensors(const torch::nn::Module& module, const std::string& prefix,
                      std::map<std::string, at::Tensor>* tensors) {
  for (const auto& item : module.named_parameters()) {
    tensors->emplace(prefix + item.key(), item.value());
  }
  for (const auto& item : module.named_buffers())
    tensors->emplace(prefix + item.key(), item.value());
}

void CopyIntoModule(const std::map<std::string, at::Tensor>& source, const std::string& prefix,
                    torch::nn::Module& module, const std::string& what) {
  std::map<std::string, at::Tensor> targets;
  AddModuleTensors(module, prefix, &targets);
  CopyTensors(source, prefix, targets, what);
}

void CopyTensors(const std::map<std::string, at::Tensor>& source, const std::string& prefix,
                 const std::map<std::string, at::Tensor>& targets, const std::string& what) {
  TensorShapes shapes;
  for (const auto& [name, target] : targets) shapes[name] = target.sizes().vec();
  RequireShapes(source, prefix, shapes, what);
  c10::NoGradGuard no_grad;
  for (const auto& [name, target] : targets) {
    const at::Tensor& tensor = source.at(name);
    if (tensor.scalar_type() != target.scalar_type() && tensor.scalar_type() != at::kHalf) {
      throw DataError(fmt::format("{}: tensor '{}' has the type {} instead of {}", what, name,
                                  at::toString(tensor.scalar_type()),
                                  at::toString(target.scalar_type())));
    }
    target.copy_(tensor);
  }
}

std::map<std::string, at::Tensor> NetworkTensors(const StructureNet& net, bool half,
                                                 const std::string& what) {
  std::map<std::string, at::Tensor> tensors;
  AddModuleTensors(*net, "", &tensors);
  if (!half) return tensors;
  for (const auto& item : net->named_parameters()) {
    const at::Tensor weights = item.value().detach().to(at::kHalf);
    if (!at::isfinite(weights).all().item<bool>()) {
      throw Error(fmt::format("{}: parameter '{}' does not fit float16: save it as float32", what,
                              item.key()));
    }
    tensors[item.key()] = weights;
  }
  return tensors;
}

void SaveCheckpoint(const std::filesystem::path& path, const StructureNet& net,
                    const CheckpointMeta& meta, bool half) {
  if (!(meta.network == net->options())) {
    throw Error(
        fmt::format("{}: the checkpoint's network options are not the network's", path.string()));
  }
  RequireClasses(meta);
  CheckpointMeta stamped = meta;
  stamped.tool = Tool();
  stamped.date = UtcNow();
  stamped.libraries = "LibTorch " TORCH_VERSION;
  WriteTensorFile(
      path, {kCheckpointFormat, MetaToJson(stamped), NetworkTensors(net, half, path.string())});
}

LoadedModel LoadCheckpoint(const std::filesystem::path& path) {
  const TensorFile file = ReadTensorFile(path, kCheckpointFormat);
  LoadedModel model;
  TensorShapes shapes;
  const auto by_metadata = [&](const auto& make) {
    try {
      make();
    } catch (const std::exception& e) {
      throw DataError(
          fmt::format("{}: invalid metadata ({})", path.string(), Shortened(FirstLine(e.what()))));
    }
  };
  by_metadata([&] {
    model.meta = MetaFromJson(file.meta);
    // The metadata may ask for a larger network than the file has. Shapes of other kinds are
    // unknown.
    if (model.meta.network.kind == "paper") shapes = PaperNetShapes(model.meta.network);
  });
  if (!shapes.empty()) RequireShapes(file.tensors, "", shapes, path.string());
  by_metadata([&] { model.net = StructureNet(model.meta.network); });
  CopyIntoModule(file.tensors, "", *model.net, path.string());
  model.net->eval();
  return model;
}

}  // namespace volalign

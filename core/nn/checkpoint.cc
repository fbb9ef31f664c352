#include "core/nn/checkpoint.h"

#include <ATen/core/ivalue.h>
#include <ATen/ops/isfinite.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>
#include <torch/csrc/jit/serialization/pickle.h>
#include <torch/version.h>

#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/base/provenance.h"
#include "core/base/text.h"
#include "core/json/json_archive.h"
#include "core/nn/paper_net.h"
#include "core/nn/tensor_archive.h"

namespace volalign {
namespace {

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

std::string FirstLine(const std::string& text) { return text.substr(0, text.find('\n')); }

using Shapes = std::map<std::string, std::vector<std::int64_t>>;

/// Throws DataError unless the tensors whose names begin with `prefix` are those of `shapes`.
void RequireShapes(const std::map<std::string, at::Tensor>& tensors, const std::string& prefix,
                   const Shapes& shapes, const std::string& what) {
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

void RequireClasses(const CheckpointMeta& meta) {
  if (meta.structure.num_classes() != meta.network.num_classes) {
    throw DataError(
        fmt::format("network.num_classes = {} violates the structure '{}', which has {}",
                    meta.network.num_classes, meta.structure.name(), meta.structure.num_classes()));
  }
}

}  // namespace

template <class Archive>
void Describe(Archive& ar, StructureNetOptions& options) {
  std::string kind =
      options.kind == "paper" ? "" : options.kind;  // absent in files of the paper's network
  ar.Optional("kind", kind);
  if constexpr (Archive::kReading) options.kind = kind.empty() ? "paper" : kind;
  ar("base_channels", options.base_channels);
  ar("num_classes", options.num_classes);
  ar("attention", options.attention);
  ar("normalization", options.normalization);
  ar("input", options.input);
  ar("residual_blocks", options.residual_blocks);
  ar("background_bias", options.background_bias);
}

template <class Archive>
void Describe(Archive& ar, Box& box) {
  ar("name", box.name);
  ar("size", box.size);
  ar("structure_from_box", box.structure_from_box);
}

template <class Archive>
void Describe(Archive& ar, Structure& structure) {
  std::string name = structure.name(), hash = structure.Hash();
  std::vector<Box> boxes = structure.boxes();
  std::vector<std::string> labels = structure.SideNames();
  ar("name", name);
  ar("boxes", boxes);
  ar("labels", labels);
  ar("sha256", hash);
  if constexpr (Archive::kReading) {
    structure = Structure::FromBoxes(name, std::move(boxes), labels);
    if (structure.Hash() != hash) throw DataError("the structure's hash does not match its boxes");
  }
}

template <class Archive>
void Describe(Archive& ar, CheckpointMeta& meta) {
  ar("tool", meta.tool);
  ar.Optional("date", meta.date);
  ar.Optional("libraries", meta.libraries);
  ar.Optional("renderer", meta.renderer);
  ar("network", meta.network);
  ar("structure", meta.structure);
  ar("focal_px", meta.focal_px);
  ar("image_sizes", meta.image_sizes);
  ar("roll_offsets_deg", meta.roll_offsets_deg);
  ar("samples", meta.samples);
  ar("config", meta.config_yaml);
}

std::string MetaToJson(const CheckpointMeta& meta) { return WriteDescribed(meta, "metadata", 1); }

void WriteTensorFile(const std::filesystem::path& path, const TensorFile& file) {
  TensorFile stored{file.format, file.meta, {}};
  c10::Dict<std::string, at::Tensor> tensors;
  for (const auto& [name, tensor] : file.tensors) {
    // A clone, because a view would be saved with the whole storage that it looks into.
    const at::Tensor plain = tensor.detach().to(at::kCPU).clone(at::MemoryFormat::Contiguous);
    stored.tensors.emplace(name, plain);
    tensors.insert(name, plain);
  }
  c10::impl::GenericDict dict(c10::StringType::get(), c10::AnyType::get());
  dict.insert("format", stored.format);
  dict.insert("meta", stored.meta);
  dict.insert("digest", Digest(stored));
  dict.insert("tensors", tensors);
  const std::vector<char> bytes = torch::jit::pickle_save(dict);
  if (bytes.size() > kMaxModelBytes) {
    throw Error(fmt::format(
        "{}: {} bytes are more than the {} that are read of such a file: use fewer base channels",
        path.string(), bytes.size(), kMaxModelBytes));
  }
  WriteFileAtomically(path, std::string_view(bytes.data(), bytes.size()));
}

TensorFile ReadTensorFile(const std::filesystem::path& path, const std::string& format) {
  const std::string content = ReadFile(FindInputFile(path.string()), kMaxModelBytes);
  const auto foreign = [&](const std::string& why) {
    return DataError(
        fmt::format("{}: not a whole file of format {} ({})", path.string(), format, why));
  };
  TensorFile file;
  std::string digest;
  try {
    TensorArchive archive = ReadTensorArchive(content);
    const auto text = [&](const char* key) -> std::string {
      const auto found = archive.texts.find(key);
      if (found == archive.texts.end()) throw DataError(fmt::format("it has no {}", key));
      return found->second;
    };
    file.format = text("format");
    if (file.format != format)
      throw DataError(fmt::format("its format is '{}'", Shortened(file.format)));
    file.meta = text("meta");
    digest = text("digest");
    file.tensors = std::move(archive.tensors["tensors"]);
  } catch (const DataError& error) {
    throw foreign(error.what());
  }
  if (Digest(file) != digest) throw foreign("its digest does not match: the content was changed");
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
  Shapes shapes;
  for (const auto& [name, target] : targets) shapes[name] = target.sizes().vec();
  RequireShapes(source, prefix, shapes, what);
  c10::NoGradGuard no_grad;
  for (auto& [name, target] : targets) {
    const at::Tensor& tensor = source.at(name);
    if (tensor.scalar_type() != target.scalar_type() && tensor.scalar_type() != at::kHalf) {
      throw DataError(fmt::format("{}: tensor '{}' has the type {} instead of {}", what, name,
                                  at::toString(tensor.scalar_type()),
                                  at::toString(target.scalar_type())));
    }
    target.copy_(tensor);
  }
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
  TensorFile file{kCheckpointFormat, MetaToJson(stamped), {}};
  AddModuleTensors(*net, "", &file.tensors);
  if (half) {
    for (const auto& item : net->named_parameters()) {
      const at::Tensor weights = item.value().detach().to(at::kHalf);
      if (!at::isfinite(weights).all().item<bool>()) {
        throw Error(fmt::format("{}: parameter '{}' does not fit float16: save it as float32",
                                path.string(), item.key()));
      }
      file.tensors[item.key()] = weights;
    }
  }
  WriteTensorFile(path, file);
}

LoadedModel LoadCheckpoint(const std::filesystem::path& path) {
  const TensorFile file = ReadTensorFile(path, kCheckpointFormat);
  LoadedModel model;
  Shapes shapes;
  try {
    model.meta = ReadDescribed<CheckpointMeta>(file.meta, "metadata");
    RequireClasses(model.meta);
    model.meta.network.Validate();
    // The metadata may ask for a larger network than the file has; another kind's is not known.
    if (model.meta.network.kind == "paper") shapes = PaperNetShapes(model.meta.network);
  } catch (const std::exception& e) {
    throw DataError(
        fmt::format("{}: invalid metadata ({})", path.string(), Shortened(FirstLine(e.what()))));
  }
  if (!shapes.empty()) RequireShapes(file.tensors, "", shapes, path.string());
  try {
    model.net = StructureNet(model.meta.network);
  } catch (const std::exception& e) {
    throw DataError(
        fmt::format("{}: invalid metadata ({})", path.string(), Shortened(FirstLine(e.what()))));
  }
  CopyIntoModule(file.tensors, "", *model.net, path.string());
  model.net->eval();
  return model;
}

void CheckStructure(const CheckpointMeta& meta, const Structure& structure) {
  const std::vector<std::string> trained = meta.structure.SideNames();
  const std::vector<std::string> given = structure.SideNames();
  if (trained == given) return;
  if (trained.size() != given.size()) {
    throw DataError(
        fmt::format("structure '{}' has {} labelled sides, the model was trained on '{}' with {}: "
                    "train a model for it",
                    structure.name(), given.size(), meta.structure.name(), trained.size()));
  }
  std::size_t i = 0;
  while (trained[i] == given[i]) ++i;
  throw DataError(fmt::format(
      "label {} of structure '{}' is '{}', the model was trained with '{}': train a model for it",
      i + 1, structure.name(), given[i], trained[i]));
}

}  // namespace volalign

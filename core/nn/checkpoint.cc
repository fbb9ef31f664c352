#include "core/nn/checkpoint.h"

#include <ATen/core/ivalue.h>
#include <ATen/ops/isfinite.h>
#include <c10/core/GradMode.h>
#include <caffe2/serialize/inline_container.h>
#include <fmt/format.h>
#include <torch/csrc/jit/serialization/import_read.h>
#include <torch/csrc/jit/serialization/pickle.h>

#include <cstring>
#include <memory>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/json/json_archive.h"

namespace volalign {
namespace {

constexpr char kTool[] = "volalign " VOLALIGN_VERSION;

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

/// A file's bytes for LibTorch's zip reader. In a file that ends in no archive the reader looks for
/// one before the first byte, and torch::jit::pickle_load, which checks no position, reads there.
class BoundedReader : public caffe2::serialize::ReadAdapterInterface {
 public:
  explicit BoundedReader(const std::string& bytes) : bytes_(bytes) {}
  std::size_t size() const override { return bytes_.size(); }
  std::size_t read(std::uint64_t pos, void* buffer, std::size_t n, const char*) const override {
    if (pos > bytes_.size() || n > bytes_.size() - pos) return 0;
    std::memcpy(buffer, bytes_.data() + pos, n);
    return n;
  }

 private:
  const std::string& bytes_;
};

c10::IValue Unpickle(const std::string& bytes) {
  caffe2::serialize::PyTorchStreamReader reader(std::make_shared<BoundedReader>(bytes));
  return torch::jit::readArchiveAndTensors("data", "", "", c10::nullopt, c10::nullopt, c10::nullopt,
                                           reader);
}

/// A pickle may claim any size and stride over a storage; look at the memory only after this.
void RequireWhole(const at::Tensor& t, const std::string& name, const std::string& path) {
  const bool plain = t.defined() && t.device().is_cpu() && t.layout() == at::kStrided &&
                     !t.is_quantized() && t.is_contiguous() && t.storage_offset() >= 0;
  if (!plain || static_cast<std::size_t>(t.storage_offset()) * t.element_size() + t.nbytes() >
                    t.storage().nbytes()) {
    throw DataError(fmt::format("{}: tensor '{}' is damaged: get the file again", path, name));
  }
}

std::string FirstLine(const std::string& text) { return text.substr(0, text.find('\n')); }

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
  WriteFileAtomically(path, std::string_view(bytes.data(), bytes.size()));
}

TensorFile ReadTensorFile(const std::filesystem::path& path, const std::string& format) {
  const std::string content = ReadFile(FindInputFile(path.string()), kMaxModelBytes);
  const auto foreign = [&](const std::string& why) {
    return DataError(
        fmt::format("{}: not a whole file of format {} ({})", path.string(), format, why));
  };
  if (content.compare(0, 4, "PK\x03\x04") != 0) throw foreign("no zip archive");
  TensorFile file;
  std::string digest;
  try {
    const c10::IValue value = Unpickle(content);
    const auto dict = value.toGenericDict();
    file.format = dict.at("format").toStringRef();
    if (file.format != format) throw foreign(fmt::format("its format is '{}'", file.format));
    file.meta = dict.at("meta").toStringRef();
    digest = dict.at("digest").toStringRef();
    for (const auto& item : dict.at("tensors").toGenericDict()) {
      file.tensors.emplace(item.key().toStringRef(), item.value().toTensor());
    }
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    throw foreign(FirstLine(e.what()));
  }
  for (const auto& [name, tensor] : file.tensors) RequireWhole(tensor, name, path.string());
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
  for (const auto& [name, tensor] : source) {
    if (name.compare(0, prefix.size(), prefix) == 0 && targets.count(name) == 0) {
      throw DataError(fmt::format("{}: tensor '{}' is not the network's", what, name));
    }
  }
  c10::NoGradGuard no_grad;
  for (auto& [name, target] : targets) {
    const auto found = source.find(name);
    if (found == source.end()) {
      throw DataError(fmt::format("{}: tensor '{}' is missing", what, name));
    }
    const at::Tensor& tensor = found->second;
    if (tensor.sizes() != target.sizes()) {
      throw DataError(fmt::format("{}: tensor '{}' has the shape [{}] instead of [{}]", what, name,
                                  fmt::join(tensor.sizes().begin(), tensor.sizes().end(), ","),
                                  fmt::join(target.sizes().begin(), target.sizes().end(), ",")));
    }
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
  stamped.tool = kTool;
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
  try {
    model.meta = ReadDescribed<CheckpointMeta>(file.meta, "metadata");
    RequireClasses(model.meta);
    model.net = StructureNet(model.meta.network);
  } catch (const std::exception& e) {
    throw DataError(fmt::format("{}: invalid metadata ({})", path.string(), FirstLine(e.what())));
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

#pragma once

#include <ATen/core/Tensor.h>

#include <filesystem>
#include <map>
#include <string>

#include "core/model/checkpoint_meta.h"
#include "core/nn/network.h"

namespace volalign {

/// A versioned safetensors file (core/nn/safetensors.h). Its header has the texts `format`,
/// `volalign.json` (`meta`) and `digest`. The digest is the SHA-256 over metadata and over names,
/// types, shapes and bytes. A flipped bit is then an error and not a bad pose.
struct TensorFile {
  std::string format;
  std::string meta;
  std::map<std::string, at::Tensor> tensors;
};

/// Writes atomically. Tensors of any device are stored on the CPU, contiguous. Throws IoError, or
/// Error for more than 4 GiB.
void WriteTensorFile(const std::filesystem::path& path, const TensorFile& file);

/// Reads a file of `format`, of at most 4 GiB. Throws IoError, or DataError for anything but a
/// whole and unchanged file of this format. For a pickle of earlier versions, the message names the
/// converter.
TensorFile ReadTensorFile(const std::filesystem::path& path, const std::string& format);

/// Copies the tensors whose names begin with `prefix` into `targets` of the same names, and
/// converts float16 to the target's type. Throws DataError with `what` and the tensor if one is
/// missing, superfluous or of another shape or type.
void CopyTensors(const std::map<std::string, at::Tensor>& source, const std::string& prefix,
                 const std::map<std::string, at::Tensor>& targets, const std::string& what);

/// The same into each of the module's parameters and buffers, under prefix + name.
void CopyIntoModule(const std::map<std::string, at::Tensor>& source, const std::string& prefix,
                    torch::nn::Module& module, const std::string& what);

/// Adds all parameters and buffers of a module under prefix + name. The tensors share the module's
/// memory.
void AddModuleTensors(const torch::nn::Module& module, const std::string& prefix,
                      std::map<std::string, at::Tensor>* tensors);

/// A network's parameters and buffers by their names. With `half`, parameters are float16, and
/// buffers (running statistics) stay float32. This halves the size; log-probabilities are equal to
/// about 1e-2. Throws Error, with `what` in its message, for a parameter that does not fit float16.
std::map<std::string, at::Tensor> NetworkTensors(const StructureNet& net, bool half,
                                                 const std::string& what);

inline constexpr char kCheckpointFormat[] = "volalign.checkpoint/2";

/// Writes network and meta; `half` as for NetworkTensors. Throws IoError. Throws Error if
/// meta.network differs from the network's options or the structure has another number of classes.
void SaveCheckpoint(const std::filesystem::path& path, const StructureNet& net,
                    const CheckpointMeta& meta, bool half);

struct LoadedModel {
  StructureNet net{nullptr};  ///< float32 on the CPU, in evaluation mode
  CheckpointMeta meta;
};

/// Reads a checkpoint. Throws IoError, or DataError in one line for files that are truncated,
/// foreign, of an unknown version, or with other tensors than the network's. The paper's network is
/// built only after its tensors were compared with the metadata.
LoadedModel LoadCheckpoint(const std::filesystem::path& path);

}  // namespace volalign

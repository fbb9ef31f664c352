#pragma once

#include <ATen/core/Tensor.h>

#include <filesystem>
#include <map>
#include <string>

#include "core/model/checkpoint_meta.h"
#include "core/nn/network.h"

namespace volalign {

/// A versioned safetensors file (core/nn/safetensors.h). Its header has the texts `format`,
/// `volalign.json` (`meta`) and `digest`, which is the SHA-256 over metadata and over names, types,
/// shapes and bytes, so that a flipped bit is an error and not a bad pose.
struct TensorFile {
  std::string format;
  std::string meta;
  std::map<std::string, at::Tensor> tensors;
};

/// Writes atomically; tensors of any device are stored on the CPU, contiguous. Throws IoError, or
/// Error for more than 4 GiB.
void WriteTensorFile(const std::filesystem::path& path, const TensorFile& file);

/// Reads a file of `format`, of at most 4 GiB. Throws IoError, or DataError for anything that is
/// not such a file, whole and unchanged; for a pickle of earlier versions it names what converts
/// it.
TensorFile ReadTensorFile(const std::filesystem::path& path, const std::string& format);

/// Copies `source[prefix + name]` into each of the module's parameters and buffers, converting
/// float16 to the target's type. Throws DataError with `what` in its message, naming the tensor,
/// when one is missing, left over or of another shape or type.
void CopyIntoModule(const std::map<std::string, at::Tensor>& source, const std::string& prefix,
                    torch::nn::Module& module, const std::string& what);

/// All parameters and buffers of a module under prefix + name; the tensors alias the module's.
void AddModuleTensors(const torch::nn::Module& module, const std::string& prefix,
                      std::map<std::string, at::Tensor>* tensors);

/// A network's parameters and buffers by their names. With `half` the parameters are float16,
/// buffers (running statistics) stay float32: half the size, log-probabilities equal to about 1e-2.
/// Throws Error, with `what` in its message, for a parameter that does not fit float16.
std::map<std::string, at::Tensor> NetworkTensors(const StructureNet& net, bool half,
                                                 const std::string& what);

inline constexpr char kCheckpointFormat[] = "volalign.checkpoint/2";

/// Writes network and meta; `half` as for NetworkTensors. Throws Error when meta.network differs
/// from the network's options or the structure has another number of classes, or IoError.
void SaveCheckpoint(const std::filesystem::path& path, const StructureNet& net,
                    const CheckpointMeta& meta, bool half);

struct LoadedModel {
  StructureNet net{nullptr};  ///< float32 on the CPU, in evaluation mode
  CheckpointMeta meta;
};

/// Throws IoError, or DataError in one line for files that are truncated, foreign, of an unknown
/// version or whose tensors are not the network's; the paper's network is built only after these
/// were compared with the metadata.
LoadedModel LoadCheckpoint(const std::filesystem::path& path);

}  // namespace volalign

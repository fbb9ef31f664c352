#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "core/geometry/structure.h"
#include "infer/view/segmenter.h"

namespace volalign {

/// The shipped network as a Segmenter.
class NetworkSegmenter : public Segmenter {
 public:
  using Segmenter::Segment;
  /// The structure that the network was trained on.
  virtual const Structure& structure() const = 0;
  virtual const std::string& file() const = 0;
  virtual const std::string& sha256() const = 0;  ///< of the checkpoint file
};

/// Loads a checkpoint (core/nn/checkpoint.h). `structure`, where given, must have the topology and
/// labels that the network was trained on. It runs on `device` (core/nn/torch_device.h). Threads of
/// LibTorch are the program's to set (core/nn/cpu/torch_threads.h). Throws IoError, DataError, or
/// ConfigError for a device that is not there.
std::unique_ptr<NetworkSegmenter> LoadNetworkSegmenter(const std::filesystem::path& checkpoint,
                                                       const Structure* structure = nullptr,
                                                       const std::string& device = "cpu");

}  // namespace volalign

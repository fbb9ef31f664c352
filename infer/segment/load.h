#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "core/geometry/structure.h"
#include "infer/view/network_segmenter.h"

namespace volalign {

/// Loads a checkpoint (core/nn/checkpoint.h). `structure`, if given, must have the topology and
/// labels that the network was trained on. It runs on `device` (core/nn/torch_device.h). The
/// program sets LibTorch's threads (core/nn/cpu/torch_threads.h). Throws IoError, DataError, or
/// ConfigError for a device that is not there.
std::unique_ptr<NetworkSegmenter> LoadNetworkSegmenter(const std::filesystem::path& checkpoint,
                                                       const Structure* structure = nullptr,
                                                       const std::string& device = "cpu");

}  // namespace volalign

#include "cli/load_segmenter.h"

#include <fmt/format.h>

#include <filesystem>
#include <opencv2/core/utility.hpp>

#include "core/base/error.h"
#include "core/nn/cpu/torch_threads.h"
#include "infer/segment/load.h"
#include "infer/segment_onnx/load.h"

namespace volalign {

std::unique_ptr<NetworkSegmenter> LoadSegmenter(const std::string& file, const Structure* structure,
                                                const std::string& device, int threads) {
  if (std::filesystem::path(file).extension() != ".onnx") {
    SetTorchThreads(threads);
    return LoadNetworkSegmenter(file, structure, device);
  }
  if (device != "cpu") {
    throw ConfigError(fmt::format(
        "device = {}: {} runs on the CPU alone; use the checkpoint (.safetensors)", device, file));
  }
  if (threads > 0) cv::setNumThreads(threads);
  return LoadOnnxSegmenter(file, structure);
}

}  // namespace volalign

#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "core/model/network_options.h"
#include "infer/view/network_segmenter.h"

namespace volalign {

/// Loads a network that `volalign export --format onnx` wrote, of either precision. OpenCV runs it
/// on the CPU in float32, without LibTorch. `structure`, if given, must have the topology and
/// labels that the network was trained on. Threads are OpenCV's (cv::setNumThreads). Throws
/// IoError, or DataError for a file that is truncated, changed, or of another program.
std::unique_ptr<NetworkSegmenter> LoadOnnxSegmenter(const std::filesystem::path& file,
                                                    const Structure* structure = nullptr);

/// A network's input for a depth map (EncodedChannels): C planes of H rows of W values one after
/// the other. Depth is in metres, 0 for none.
std::vector<float> EncodeDepth(const DepthImage& depth, InputEncoding input);

}  // namespace volalign

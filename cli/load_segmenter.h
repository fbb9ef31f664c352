#pragma once

#include <memory>
#include <string>

#include "core/geometry/structure.h"
#include "infer/view/network_segmenter.h"

namespace volalign {

/// The network of --model by the file's ending: of .onnx by OpenCV (infer/segment_onnx/load.h), on
/// the CPU, else a checkpoint by LibTorch (infer/segment/load.h). Sets the threads of the one that
/// runs it for the whole process; 0 leaves them as they are. Throws as these do, and ConfigError
/// for another device than cpu and a .onnx.
std::unique_ptr<NetworkSegmenter> LoadSegmenter(const std::string& file, const Structure* structure,
                                                const std::string& device, int threads);

}  // namespace volalign

#pragma once

#include <memory>
#include <string>

#include "core/geometry/structure.h"
#include "infer/view/network_segmenter.h"

namespace volalign {

/// The network of --model, by the file's ending. OpenCV runs .onnx on the CPU
/// (infer/segment_onnx/load.h), LibTorch a checkpoint (infer/segment/load.h). Sets its library's
/// threads for the whole process; 0 leaves them as they are. Throws as these do, and ConfigError
/// for .onnx with another device than cpu.
std::unique_ptr<NetworkSegmenter> LoadSegmenter(const std::string& file, const Structure* structure,
                                                const std::string& device, int threads);

}  // namespace volalign

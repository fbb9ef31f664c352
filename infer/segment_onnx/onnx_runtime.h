#pragma once

#include <functional>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "infer/segment_onnx/load.h"

namespace volalign {

/// Runs the network of an ONNX file's `bytes`, with `classes` classes, by ONNX Runtime on the CPU
/// with `threads` threads. The library is opened here, and stays: the file `library`, or where that
/// is "" the one that the system's loader finds. Throws ConfigError where it cannot be opened, is
/// not ONNX Runtime, or cannot take the network; what it returns throws Error.
OnnxRuntime StartOnnxRuntime(const std::string& library, const std::string& bytes, int classes,
                             int threads);

}  // namespace volalign

#pragma once

#include <memory>
#include <string>

#include "core/geometry/structure.h"
#include "infer/view/network_segmenter.h"

namespace volalign::python {

/// As LoadOnnxSegmenter; `runtime` as in `calibrate`. ONNX Runtime is that of Python, if installed,
/// with `threads` of its own, and takes Python's lock while it is called; the segmenter has to be
/// destroyed with that lock. Throws ConfigError for another `runtime` and one that is not
/// installed.
std::unique_ptr<NetworkSegmenter> LoadByRuntime(const std::string& file, const Structure* structure,
                                                const std::string& runtime, int threads);

}  // namespace volalign::python

#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "infer/view/network_segmenter.h"

namespace volalign {

/// Loads a network that `volalign export --format onnx` wrote, of either precision, and runs it by
/// OpenCV, on the CPU, in float32, without LibTorch. `structure`, where given, must have the
/// topology and labels that the network was trained on. Threads are OpenCV's (cv::setNumThreads).
/// Throws IoError, or DataError for a file that is truncated, changed, or of another program.
std::unique_ptr<NetworkSegmenter> LoadOnnxSegmenter(const std::filesystem::path& file,
                                                    const Structure* structure = nullptr);

/// What runs a network instead of OpenCV.
struct OnnxRuntime {
  std::string name;  ///< with its version: "ONNX Runtime 1.17.1"
  /// Log-probabilities of a depth map in metres, 0 where there is none: K planes of H rows of W
  /// values one after the other. Called by any thread, one call at a time.
  std::function<std::vector<float>(const DepthImage& depth)> log_probabilities;
};

/// The same by the runtime that `start` gives for the file's bytes, which are checked before.
/// Segment throws Error where log-probabilities have another size, and what the runtime throws.
std::unique_ptr<NetworkSegmenter> LoadOnnxSegmenter(
    const std::filesystem::path& file, const Structure* structure,
    const std::function<OnnxRuntime(const std::string& bytes)>& start);

/// The same by `runtime`: "opencv"; "onnxruntime", the library that the system's loader finds; the
/// path of that library, which has a '/'; or "auto", ONNX Runtime where the loader finds it and it
/// takes the network, else OpenCV. ONNX Runtime has `threads` threads of its own, and stays loaded.
/// Throws ConfigError for another `runtime`, and for one that cannot be had.
std::unique_ptr<NetworkSegmenter> LoadOnnxSegmenter(const std::filesystem::path& file,
                                                    const Structure* structure,
                                                    const std::string& runtime, int threads);

}  // namespace volalign

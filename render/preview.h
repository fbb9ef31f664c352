#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "render/sample_config.h"

namespace volalign {

class DepthRenderer;

struct PreviewOptions {
  std::uint64_t seed = 0;
  std::uint64_t first_index = 0;
  int count = 24;  ///< samples of each sensor kind
  /// Folder of real depth frames, or empty: all .pgm files and the 16-bit .png files with "depth"
  /// in their names. A frame belongs to the sensor of `config` with its aspect ratio, and has that
  /// sensor's first intrinsics of the pool. Its label map is `labels/NAME.png`, if that exists
  /// (from `volalign calibrate`; NAME without "_Depth").
  std::filesystem::path real_frames;
  double real_depth_scale = 0.001;  ///< m per step
};

/// Draws preview.png in `dir`. For each sensor of `config` it has real frames, then the first
/// twelve samples, each as depth beside its labels, upright for the first mounting roll. Returns a
/// Markdown table of DepthStatistics for each sensor: rendered, rendered before noise, and real.
/// Samples have the size of the real frames if there are any, else that of the configuration.
/// Throws IoError, ConfigError, or DataError (a folder without depth frames, or a frame with no
/// configured sensor's aspect ratio).
std::string WritePreview(const std::filesystem::path& dir, const SampleConfig& config,
                         const PreviewOptions& options, DepthRenderer& renderer);

}  // namespace volalign

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
  /// Folder of real depth frames, or empty: all .pgm files and the 16-bit .png files whose name
  /// holds "depth". A frame belongs to the sensor of `config` whose aspect ratio it has, is taken
  /// to have that sensor's first intrinsics of the pool, and its label map is `labels/NAME.png`
  /// where that is there (as `volalign calibrate` writes it; NAME without "_Depth").
  std::filesystem::path real_frames;
  double real_depth_scale = 0.001;  ///< m per step
};

/// Draws preview.png in `dir`: for each sensor of `config` its real frames, then the first twelve
/// samples, each as depth beside its labels, upright for the first mounting roll. Returns a
/// Markdown table of DepthStatistics for each sensor: rendered, rendered before noise, and real.
/// Samples have the size of the real frames where there are some, else that of the configuration.
/// Throws IoError, DataError (a folder without depth frames, a frame of no configured sensor's
/// aspect ratio) or ConfigError.
std::string WritePreview(const std::filesystem::path& dir, const SampleConfig& config,
                         const PreviewOptions& options, DepthRenderer& renderer);

}  // namespace volalign

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/image.h"
#include "core/pose.h"

namespace volalign {

/// quarter_turns of a sensor whose mounting is to be found.
inline constexpr int kAutoTurns = -1;

/// One sensor's still frame in memory: all that calibration needs.
struct SensorFrame {
  std::string name;
  DepthImage depth;  ///< m, 0 where nothing was measured
  Intrinsics intrinsics;
  /// Clockwise quarter turns that bring the image into the network's training orientation, or
  /// kAutoTurns.
  int quarter_turns = kAutoTurns;
  std::optional<Pose> ground_truth;  ///< structure_from_sensor

  // Carried into extrinsics.json, not used.
  std::vector<std::string> depth_files;  ///< as the capture names them
  double depth_scale = 0.001;            ///< m per unit of the depth files
  std::string serial;
};

/// A capture.json (design section 9) with its images.
struct Capture {
  std::filesystem::path path;
  std::vector<SensorFrame> sensors;
  std::optional<std::filesystem::path>
      structure;  ///< relative paths resolved against the JSON's folder
};

inline constexpr char kCaptureFormat[] = "volalign.capture/1";

/// Reads capture.json and its depth files. A list of depth files is one still: each pixel becomes
/// the (lower) median of its non-zero values, so that no value is invented between foreground and
/// background. Throws IoError for a missing file, and DataError in one line naming file, sensor and
/// way out for bad JSON, unknown or duplicate keys, null, duplicate sensor names, another format,
/// bad images, or sizes that differ from the intrinsics'.
Capture ReadCapture(const std::filesystem::path& path);

}  // namespace volalign

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "infer/view/sensor_frame.h"

namespace volalign {

/// A capture.json (docs/formats.md) with its images.
struct Capture {
  std::filesystem::path path;
  std::vector<SensorFrame> sensors;
  std::optional<std::filesystem::path>
      structure;  ///< relative paths resolved against the JSON's folder
};

/// Whether a sensor's name serves as the name of its files, beside "overview" and "merged", and in
/// what a terminal shows.
bool IsFileName(const std::string& name);

inline constexpr char kCaptureFormat[] = "volalign.capture/1";

/// Reads capture.json and its depth files or recordings. A list of depth files, or the first frames
/// of a recording, is one still (infer/capture/mean_depth.h). Throws IoError for a missing file,
/// and DataError in one line naming file, sensor and way out for bad JSON, unknown or duplicate
/// keys, null, duplicate sensor names, another format, bad images, or sizes that differ from the
/// intrinsics'.
Capture ReadCapture(const std::filesystem::path& path);

/// Captures of the same sensors as stills, each with a name that serves as the name of a folder:
/// the file's without its ending or, where that is not unique, its folder's; failing that, still_1
/// and so on. A single one has none.
std::vector<Still> StillsOf(std::vector<Capture> captures);

}  // namespace volalign

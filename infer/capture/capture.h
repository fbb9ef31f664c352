#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "infer/view/sensor_frame.h"

namespace volalign {

/// The content of a capture.json (docs/formats.md), with its images.
struct CaptureFile {
  std::filesystem::path path;
  std::vector<SensorFrame> sensors;
  std::optional<std::filesystem::path> structure;  ///< resolved against the JSON's folder
};

/// Can a sensor's name be the name of its files, beside "overview" and "merged", and be shown in a
/// terminal?
bool IsFileName(const std::string& name);

inline constexpr char kCaptureFormat[] = "volalign.capture/1";

/// Reads capture.json and its depth files or recordings. A list of depth files, or the first frames
/// of a recording, become one mean depth map (infer/capture/mean_depth.h). Throws IoError for a
/// missing file. Throws DataError for bad JSON, unknown or duplicate keys, null, duplicate sensor
/// names, another format, bad images, or sizes that differ from the intrinsics'. Messages are one
/// line and name the file, the sensor and a remedy.
CaptureFile ReadCapture(const std::filesystem::path& path);

/// Gives captures of the same sensors names that serve as names of folders. The name is that of the
/// file without its ending or, if that is not unique, of its folder, else still_1 and so on. A
/// single capture has none.
std::vector<Capture> NameCaptures(std::vector<CaptureFile> files);

}  // namespace volalign

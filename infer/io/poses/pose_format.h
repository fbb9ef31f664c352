#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "infer/io/poses/sensor_pose.h"

namespace volalign {

/// Files in which programs keep camera poses; docs/conversion.md says what stands in each.
enum class PoseFormat {
  kVolalign,
  kPoses,
  kOpen3d,
  kOpen3dLog,
  kColmap,
  kOpencv,
  kRos,
  kUnity,
  kVolumetricCapture,
  kTum,
  kCsv
};
inline constexpr std::array<std::pair<const char*, PoseFormat>, 11> kPoseFormatWords = {
    {{"volalign", PoseFormat::kVolalign},
     {"poses", PoseFormat::kPoses},
     {"open3d", PoseFormat::kOpen3d},
     {"open3d_log", PoseFormat::kOpen3dLog},
     {"colmap", PoseFormat::kColmap},
     {"opencv", PoseFormat::kOpencv},
     {"ros", PoseFormat::kRos},
     {"unity", PoseFormat::kUnity},
     {"volumetric_capture", PoseFormat::kVolumetricCapture},
     {"tum", PoseFormat::kTum},
     {"csv", PoseFormat::kCsv}}};

/// Throws ConfigError, with all words, for one that is none of them.
PoseFormat ParsePoseFormat(const std::string& word);

/// Reads a file, or a folder for colmap and volumetric_capture. Formats without names name the
/// sensors by their number. Throws IoError or DataError.
std::vector<SensorPose> ReadPoses(const std::filesystem::path& path, PoseFormat format);

/// Writes atomically, over what is there. Returns what the format has no place for, a sentence
/// each. Throws IoError, or ConfigError for `volalign`, which only `volalign calibrate` writes, and
/// for formats that need intrinsics where they are not known.
std::vector<std::string> WritePoses(const std::filesystem::path& path, PoseFormat format,
                                    const std::vector<SensorPose>& poses);

}  // namespace volalign

#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "infer/formats/poses/sensor_pose.h"

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
  kLivescanKinectV2,
  kLivescanAzure,
  kTum,
  kCsv
};
inline constexpr std::array<std::pair<const char*, PoseFormat>, 13> kPoseFormatWords = {
    {{"volalign", PoseFormat::kVolalign},
     {"poses", PoseFormat::kPoses},
     {"open3d", PoseFormat::kOpen3d},
     {"open3d_log", PoseFormat::kOpen3dLog},
     {"colmap", PoseFormat::kColmap},
     {"opencv", PoseFormat::kOpencv},
     {"ros", PoseFormat::kRos},
     {"unity", PoseFormat::kUnity},
     {"volumetric_capture", PoseFormat::kVolumetricCapture},
     {"livescan3d_kinect_v2", PoseFormat::kLivescanKinectV2},
     {"livescan3d_azure", PoseFormat::kLivescanAzure},
     {"tum", PoseFormat::kTum},
     {"csv", PoseFormat::kCsv}}};

/// What formats need that an extrinsics.json does not have.
struct PoseFormatOptions {
  /// By a sensor's name, where its depth camera is in the frame of its colour camera: p_colour = T
  /// p_depth. livescan3d_azure, whose points are the colour camera's, needs it of every sensor.
  std::map<std::string, Pose> colour_from_depth;
};

/// Throws ConfigError, with all words, for one that is none of them.
PoseFormat ParsePoseFormat(const std::string& word);

/// Whether poses in that format are a folder of files.
bool IsFolder(PoseFormat format);

/// Reads a file, or a folder where the format is one. Formats without names name the sensors by
/// their number. Throws IoError, DataError, or ConfigError where `options` lack something.
std::vector<SensorPose> ReadPoses(const std::filesystem::path& path, PoseFormat format,
                                  const PoseFormatOptions& options = {});

/// Writes atomically, over what is there. Returns what the format has no place for, a sentence
/// each. Throws IoError, or ConfigError for `volalign`, which only `volalign calibrate` writes, and
/// where the format needs intrinsics, or something of `options`, that are not known.
std::vector<std::string> WritePoses(const std::filesystem::path& path, PoseFormat format,
                                    const std::vector<SensorPose>& poses,
                                    const PoseFormatOptions& options = {});

}  // namespace volalign

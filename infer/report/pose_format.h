#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/config/config_word.h"
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
  kCwipc,
  kTum,
  kCsv
};
constexpr Words<PoseFormat, 14> WordsOf(PoseFormat) {
  return {{{"volalign", PoseFormat::kVolalign},
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
           {"cwipc", PoseFormat::kCwipc},
           {"tum", PoseFormat::kTum},
           {"csv", PoseFormat::kCsv}}};
}

/// Colour cameras by their sensors' names. livescan3d_azure, whose points are the colour camera's,
/// needs that of every sensor, to be read and to be written.
using ColourCameras = std::map<std::string, ColourCamera>;

/// The world that a file's poses are in, and the camera that they are of.
struct WorldChoice {
  /// "structure": the structure's own origin; "floor": the point of the floor below it; or a
  /// sensor's name.
  std::string origin = "structure";
  /// "y" or "z": the axis that is up, z by (x, y, z) -> (x, -z, y). "": what the format says, z for
  /// ros and volumetric_capture, else y; with a sensor as the origin, that camera's own axes in the
  /// formats that leave the choice (not in ros, unity and volumetric_capture), so that its pose is
  /// the identity.
  std::string up;
  bool colour = false;  ///< poses and intrinsics of the colour cameras, not of the depth cameras
  /// Height of the floor in the structure frame, m, which "floor" needs.
  std::optional<double> floor_m;
};

/// Throws ConfigError, with all words, for one that is none of them.
PoseFormat ParsePoseFormat(const std::string& word);

/// Whether poses in that format are a folder of files.
bool IsFolder(PoseFormat format);

/// Reads a file, or a folder where the format is one; of `volalign`, also the folder of a
/// calibration. Formats without names name the sensors by
/// their number. Poses are as the file has them, y up. Sensors get the colour cameras given for
/// them, which go before those of the file. Throws IoError, DataError, or ConfigError where a
/// colour camera is needed and not known.
std::vector<SensorPose> ReadPoses(const std::filesystem::path& path, PoseFormat format,
                                  const ColourCameras& colour = {});

/// The floor's height in the structure frame, m; none where the file does not say it. Throws as
/// ReadPoses.
std::optional<double> ReadFloor(const std::filesystem::path& path, PoseFormat format);

/// Writes atomically, over what is there. Returns what the format has no place for and what
/// becomes of the depth corrections, a sentence each. Throws IoError, or ConfigError for
/// `volalign`, which only `volalign calibrate` writes, and where something is not known that the
/// format or the choice needs.
std::vector<std::string> WritePoses(const std::filesystem::path& path, PoseFormat format,
                                    const std::vector<SensorPose>& poses,
                                    const WorldChoice& choice = {});

}  // namespace volalign

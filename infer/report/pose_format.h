#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "infer/formats/poses/sensor_pose.h"
#include "infer/report/extrinsics.h"
#include "infer/report/world_frame.h"

namespace volalign {

/// The words of the formats of camera poses of other programs; docs/conversion.md describes each.
/// Any other word is a ConfigError of the functions below.
std::vector<std::string> PoseFormats();
inline constexpr char kVolalignPoses[] = "volalign";  ///< an extrinsics.json

/// Colour cameras by their sensors' names. livescan3d_azure has points of the colour camera, so
/// reading and writing it needs that of every sensor.
using ColourCameras = std::map<std::string, ColourCamera>;

/// The world frame of a file's poses, and the camera that they belong to.
struct WorldChoice {
  /// "structure": the structure's own origin. "floor": the point of the floor below it. "world":
  /// `world`. Else a sensor's name. If empty, it is the world if there is one, else the structure.
  std::string origin;
  /// The axis that is up: "y", or "z" by (x, y, z) -> (x, -z, y). If empty, it is the format's own
  /// axis: z for ros, ros_launch, urdf and volumetric_capture, else y. With a sensor as the origin
  /// and no axis, the camera's own axes are taken and its pose is the identity. Not so in formats
  /// with a fixed axis, which are those and unity.
  std::string up;
  std::string frame;    ///< name of the world in formats that have one, if not by the origin
  bool colour = false;  ///< poses and intrinsics of colour cameras, not depth cameras
  bool raw = false;     ///< poses that fit depths without their correction best
  /// Height of the floor in the structure frame, m; "floor" needs it.
  std::optional<double> floor_m;
  /// Its axes are taken as they are, also in formats with a fixed axis.
  std::optional<WorldFrame> world;
};

/// Can files of that format be read? They can of all but `ros_launch`, `urdf` and
/// `depth_correction`. All but `volalign` are written.
bool IsReadable(const std::string& format);

/// Is that format a folder of files?
bool IsFolder(const std::string& format);

/// The sensors of a calibration that have a pose.
std::vector<SensorPose> PosesOf(const Extrinsics& extrinsics);

/// Reads a file, or a folder if the format is one, or the folder of a calibration for `volalign`.
/// Formats without names name the sensors by their number. Poses are as in the file, y up. Colour
/// cameras in `colour` replace those of the file. Throws IoError, DataError, or ConfigError if a
/// colour camera is needed and not known, or if the format is only written.
std::vector<SensorPose> ReadPoses(const std::filesystem::path& path, const std::string& format,
                                  const ColourCameras& colour = {});

/// Takes the floor's height and the world of `calibrate --world` from an extrinsics.json that has
/// them. Other formats have neither. Throws as ReadPoses.
void ReadWorld(const std::filesystem::path& path, const std::string& format, WorldChoice* choice);

/// Writes atomically, over existing files. Returns a sentence for everything that the format has no
/// place for, and one on the depth corrections, each with its cost in millimetres. Throws IoError.
/// Throws ConfigError for `volalign`, which only `volalign calibrate` writes, and if the format or
/// the choice needs something that is not known.
std::vector<std::string> WritePoses(const std::filesystem::path& path, const std::string& format,
                                    const std::vector<SensorPose>& poses,
                                    const WorldChoice& choice = {});

}  // namespace volalign

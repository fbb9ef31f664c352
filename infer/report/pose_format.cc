#include "infer/report/pose_format.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>
#include <string_view>
#include <variant>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "infer/formats/poses/codecs.h"
#include "infer/report/extrinsics.h"

namespace volalign {

namespace {

using namespace poses_internal;

using PosesOfText = Poses (*)(const std::string& text, const std::string& name);
using TextOfPoses = std::string (*)(const Poses& poses, const FileFrame& frame);
using PosesOfFiles = Poses (*)(const Files& files);
using FilesOfPoses = Files (*)(const Poses& poses, const FileFrame& frame);

/// A file format.
struct Format {
  const char* word;
  /// Of a format that is one text, or of one that is a folder. Null if it is not read or written.
  std::variant<PosesOfText, PosesOfFiles> read;
  std::variant<TextOfPoses, FilesOfPoses> write;
  /// The axis that is up in every file; empty if the format leaves the choice.
  std::string_view up = "";
  bool holds_intrinsics = true, holds_depth = true;  ///< depth: gain and offset
  bool needs_intrinsics = false;

  bool readable() const {
    return std::string_view(word) == kVolalignPoses ||
           std::visit([](auto read_by) { return read_by != nullptr; }, read);
  }
  bool folder() const { return std::holds_alternative<FilesOfPoses>(write); }
};

constexpr PosesOfText kNotRead = nullptr;
constexpr TextOfPoses kNotWritten = nullptr;
constexpr char kKinectV2[] = "livescan3d_kinect_v2", kAzure[] = "livescan3d_azure";

constexpr Format kFormats[] = {
    {kVolalignPoses, kNotRead, kNotWritten},
    {"poses", ReadPosesJson, WritePosesJson},
    {"open3d", ReadOpen3d, WriteOpen3d, "", true, true, true},
    {"open3d_log", ReadOpen3dLog, WriteOpen3dLog, "", false},
    {"colmap", ReadColmap, WriteColmap, "", true, true, true},
    {"opencv", ReadOpencv, WriteOpencv},
    {"ros", ReadRos, WriteRos, "z", false},
    {"ros_launch", kNotRead, WriteRosLaunch, "z", false},
    {"urdf", kNotRead, WriteUrdf, "z", false, false},
    {"unity", ReadUnity, WriteUnity, "y"},
    {"volumetric_capture", ReadVolumetricCapture, WriteVolumetricCapture, "z", false, false},
    {kKinectV2, ReadLivescan, WriteLivescan, "", false, false},
    {kAzure, ReadLivescan, WriteLivescan, "", false, false},
    {"cwipc", ReadCwipc, WriteCwipc, "", false},
    {"tum", ReadTum, WriteTum, "", false},
    {"csv", ReadCsv, WriteCsv},
    {"depth_correction", kNotRead, WriteDepthCorrection, "", true, true, true}};

/// Throws ConfigError with all words for any other.
const Format& FormatOf(const std::string& word) {
  for (const Format& format : kFormats) {
    if (format.word == word) return format;
  }
  throw ConfigError(
      fmt::format("\"{}\" is no format; known are {}", word, fmt::join(PoseFormats(), ", ")));
}

/// Pose of the camera that a file's pose belongs to: p_camera = T p_depth. Clients of LiveScan3D
/// for a Kinect v2 and for an Azure Kinect transform points of another one.
Pose CameraOf(const std::string& format, const std::string& name,
              const std::optional<ColourCamera>& colour) {
  Pose pose = Pose::Identity();
  if (format == kKinectV2) pose.linear() = KinectV2FromSensor();
  if (format != kAzure) return pose;
  if (!colour) {
    throw ConfigError(fmt::format(
        "livescan3d_azure: poses are those of colour cameras, and the place of {0}'s colour camera "
        "is not known; give the device's raw calibration with --colour-camera {0}=FILE.json",
        name));
  }
  return colour->colour_from_depth;
}

Files ReadFolder(const std::filesystem::path& path) {
  Files files;
  std::error_code error;
  for (std::filesystem::directory_iterator it(path, error), end; !error && it != end;
       it.increment(error)) {
    const std::string name = it->path().filename().string();
    if (IsFileOfPoses(name)) files[name] = ReadFile(it->path(), kMaxResultBytes);
  }
  if (error) throw IoError(fmt::format("{}: {}", path.string(), error.message()));
  return files;
}

Pose ZUp() {
  Pose pose = Pose::Identity();
  pose.linear() = ZUpFromYUp();
  return pose;
}

const SensorPose& SensorNamed(const std::vector<SensorPose>& poses, const std::string& name) {
  std::vector<std::string> names;
  for (const SensorPose& pose : poses) {
    if (pose.name == name) return pose;
    names.push_back(pose.name);
  }
  throw ConfigError(
      fmt::format("--origin {}: neither structure, floor nor a sensor with a pose; those are {}",
                  name, fmt::join(names, ", ")));
}

/// The poses of the colour cameras instead of the depth cameras.
std::vector<SensorPose> ColourPoses(const std::vector<SensorPose>& poses) {
  std::vector<SensorPose> colour;
  for (const SensorPose& pose : poses) {
    if (!pose.colour) {
      throw ConfigError(fmt::format(
          "--camera colour: the place of {0}'s colour camera is not known; give \"colour\" in "
          "capture.json, or the raw calibration of an Azure Kinect with --colour-camera "
          "{0}=FILE.json",
          pose.name));
    }
    colour.push_back({pose.name,
                      pose.structure_from_sensor * pose.colour->colour_from_depth.inverse(),
                      pose.colour->intrinsics,
                      {},
                      pose.serial});
  }
  return colour;
}

/// p_world = T p_structure, and the file's description of the world.
std::pair<Pose, FileFrame> WorldOf(const std::string& format, const std::vector<SensorPose>& poses,
                                   const WorldChoice& choice) {
  const std::string fixed(FormatOf(format).up);
  std::string from = choice.origin;
  if (from.empty()) from = choice.world ? "world" : "structure";
  if (from == "world") {
    if (!choice.world)
      throw ConfigError("--origin world: the input has none; `calibrate --world` stores it");
    if (!choice.up.empty())
      throw ConfigError("--up: the world has its own axes; --origin structure has others");
    const WorldFrame& world = *choice.world;
    return {world.world_from_structure,
            {"axes and origin of " + world.name, world.name, choice.colour}};
  }
  if (!choice.up.empty() && !fixed.empty() && choice.up != fixed) {
    throw ConfigError(fmt::format("--up {}: in files of {}, {} is up", choice.up, format, fixed));
  }
  const std::string up = fixed.empty() ? choice.up : fixed;
  FileFrame frame{"", from, choice.colour};
  Pose world = Pose::Identity();
  std::string origin;
  if (from == "floor") {
    if (!choice.floor_m) {
      throw ConfigError(
          "--origin floor: the input does not say where the floor is; an extrinsics.json of this "
          "version of volalign does");
    }
    world.translation().y() = -*choice.floor_m;
    origin = ", origin on the floor below the structure's";
  } else if (from != "structure") {
    const SensorPose& sensor = SensorNamed(poses, from);
    if (up.empty()) {
      frame.world = fmt::format("the camera of {}, x right, y down, z forward", sensor.name);
      return {sensor.structure_from_sensor.inverse(), frame};
    }
    world.translation() = -sensor.structure_from_sensor.translation();
    origin = fmt::format(", origin at the camera of {}", sensor.name);
    frame.name = "level_at_" + sensor.name;
  }
  frame.world =
      (up == "z" ? "z up, right-handed, (x, y, z) of volalign's structure frame is (x, -z, y)"
                 : "y up, right-handed") +
      origin;
  return {up == "z" ? ZUp() * world : world, frame};
}

std::vector<SensorPose> ReadAny(const std::filesystem::path& path, const Format& format) {
  if (format.word == std::string(kVolalignPoses)) return PosesOf(ReadExtrinsics(path));
  if (!format.readable()) throw ConfigError(fmt::format("{} is written and not read", format.word));
  if (const auto* read = std::get_if<PosesOfFiles>(&format.read)) return (*read)(ReadFolder(path));
  return std::get<PosesOfText>(format.read)(ReadFile(path, kMaxResultBytes), path.string());
}

/// "S1 +3.2, S2 -0.4", of the sensors with a value above a tenth of a millimetre.
std::string Millimetres(const std::vector<SensorPose>& poses,
                        const std::function<double(const SensorPose&)>& metres) {
  std::vector<std::string> sensors;
  for (const SensorPose& pose : poses) {
    const double mm = 1000 * metres(pose);
    if (std::abs(mm) >= 0.05) sensors.push_back(fmt::format("{} {:+.1f}", pose.name, mm));
  }
  return fmt::format("{}", fmt::join(sensors, ", "));
}

/// A sentence on the depth corrections, each with its size at the structure's distance; "" without
/// any.
std::string DepthNote(const std::string& format, const std::vector<SensorPose>& poses,
                      bool colour) {
  const std::string off = Millimetres(poses, [](const SensorPose& pose) {
    const double distance = pose.structure_from_sensor.translation().norm();
    return (pose.depth_gain - 1) * distance + pose.depth_offset_m;
  });
  if (off.empty()) return "";
  return fmt::format(
      "the poses belong to corrected depths, {}. Without the correction, points at the structure "
      "are off (mm): {}",
      colour ? "and these corrections of the depth cameras are not in the file"
      : !FormatOf(format).holds_depth ? "and these corrections have no place in it"
      : format == "depth_correction"  ? "which these files describe"
                                     : "by each sensor's depth_gain and depth_offset_m in the file",
      off);
}

/// The poses that fit uncorrected depths best, and a sentence on what they leave.
std::string TurnIntoRaw(std::vector<SensorPose>* poses) {
  const std::string off =
      Millimetres(*poses, [](const SensorPose& pose) { return PoseForRawDepth(pose).rms; });
  for (SensorPose& pose : *poses) {
    pose.structure_from_sensor = PoseForRawDepth(pose).target_from_source;
    pose.depth_gain = 1;
    pose.depth_offset_m = 0;
  }
  if (off.empty()) return "";
  return "the poses fit uncorrected depths best. Points within 1 m of the structure are still off "
         "(mm, RMS): " +
         off;
}

/// Throws if the format cannot be written. Returns a sentence on everything that it leaves out.
std::vector<std::string> CheckPlace(const std::string& format,
                                    const std::vector<SensorPose>& poses) {
  const Format& traits = FormatOf(format);
  bool intrinsics = false, distortion = false;
  for (const SensorPose& pose : poses) {
    if (traits.needs_intrinsics && !pose.intrinsics)
      throw ConfigError(
          fmt::format("{} needs intrinsics, and those of \"{}\" are not known", format, pose.name));
    if (traits.folder() && format != "colmap" &&
        (pose.name.empty() || pose.name.find('/') != std::string::npos || pose.name[0] == '.'))
      throw ConfigError(fmt::format("\"{}\" is no name of a file", pose.name));
    intrinsics = intrinsics || pose.intrinsics;
    distortion = distortion || (pose.intrinsics && !pose.intrinsics->distortion.empty());
  }
  std::vector<std::string> lost;
  if (intrinsics && !traits.holds_intrinsics) {
    const std::string off = Millimetres(poses, LensShift);
    lost.push_back("the intrinsics have no place in it" +
                   (off.empty() ? off
                                : ". With those of the capture, points at the structure are off by "
                                  "up to (mm): " +
                                      off));
  }
  if (distortion && format == "open3d")
    lost.push_back(
        "the distortion has no place in it: Open3D's cameras are pinholes, so undistort the "
        "pictures");
  if (format == kAzure) {
    lost.push_back(
        "LiveScan3D reads calibration_SERIAL.txt in its working folder. So a sensor's name has to "
        "be its serial number. Some clients look for a file without .txt: copy it to that name");
  }
  return lost;
}

}  // namespace

std::vector<std::string> PoseFormats() {
  std::vector<std::string> words;
  for (const Format& format : kFormats) words.emplace_back(format.word);
  return words;
}

bool IsReadable(const std::string& format) { return FormatOf(format).readable(); }

bool IsFolder(const std::string& format) { return FormatOf(format).folder(); }

std::vector<SensorPose> PosesOf(const Extrinsics& extrinsics) {
  std::vector<SensorPose> poses;
  for (const Extrinsics::Sensor& sensor : extrinsics.sensors) {
    if (!sensor.structure_from_sensor) continue;
    poses.push_back(
        {sensor.name, *sensor.structure_from_sensor, sensor.intrinsics, {}, sensor.serial});
    poses.back().intrinsics_given = sensor.intrinsics_given;
    if (std::isfinite(sensor.depth_gain) && std::isfinite(sensor.depth_offset_m)) {
      poses.back().depth_gain = sensor.depth_gain;
      poses.back().depth_offset_m = sensor.depth_offset_m;
    }
    if (sensor.colour) poses.back().colour = static_cast<const ColourCamera&>(*sensor.colour);
  }
  return poses;
}

std::vector<SensorPose> ReadPoses(const std::filesystem::path& path, const std::string& format,
                                  const ColourCameras& colour) {
  std::vector<SensorPose> poses = ReadAny(path, FormatOf(format));
  if (poses.empty()) throw DataError(fmt::format("{}: no sensor with a pose", path.string()));
  for (SensorPose& pose : poses) {
    RequirePlainName(pose.name, path.string());
    if (FormatOf(format).up == "z")
      pose.structure_from_sensor = ZUp().inverse() * pose.structure_from_sensor;
    const auto given = colour.find(pose.name);
    if (given != colour.end()) pose.colour = given->second;
    pose.structure_from_sensor =
        pose.structure_from_sensor * CameraOf(format, pose.name, pose.colour);
  }
  return poses;
}

void ReadWorld(const std::filesystem::path& path, const std::string& format, WorldChoice* choice) {
  if (format != kVolalignPoses) return;
  const Extrinsics extrinsics = ReadExtrinsics(path);
  choice->floor_m = extrinsics.structure.floor_m;
  choice->world = extrinsics.world;
}

std::vector<std::string> WritePoses(const std::filesystem::path& path, const std::string& format,
                                    const std::vector<SensorPose>& poses,
                                    const WorldChoice& choice) {
  const Format& traits = FormatOf(format);
  if (format == kVolalignPoses)
    throw ConfigError(
        "only `volalign calibrate` writes an extrinsics.json; --to poses has the "
        "poses and intrinsics alone");
  if (choice.colour && (format == kKinectV2 || format == kAzure)) {
    throw ConfigError(
        fmt::format("--camera colour: {} says by itself which camera its poses are of", format));
  }
  std::set<std::string> names;
  for (const SensorPose& pose : poses) {
    RequirePlainName(pose.name, path.string());
    if (!names.insert(pose.name).second)
      throw DataError(fmt::format("{}: two poses are named \"{}\"", path.string(), pose.name));
  }
  if (choice.raw && (choice.colour || format == "depth_correction")) {
    throw ConfigError(fmt::format("--poses-for raw: {} has nothing to do with uncorrected depths",
                                  choice.colour ? "--camera colour" : format));
  }
  std::vector<SensorPose> cameras = choice.colour ? ColourPoses(poses) : poses;
  const std::string raw_note = choice.raw ? TurnIntoRaw(&cameras) : "";
  auto [world_from_structure, frame] = WorldOf(format, cameras, choice);
  if (!choice.frame.empty()) {
    RequirePlainName(choice.frame, "--frame");
    frame.name = choice.frame;
  }
  std::vector<std::string> notes = CheckPlace(format, cameras);
  for (SensorPose& camera : cameras) {
    camera.structure_from_sensor = world_from_structure * camera.structure_from_sensor *
                                   CameraOf(format, camera.name, camera.colour).inverse();
  }
  const std::string note = choice.raw ? raw_note : DepthNote(format, poses, choice.colour);
  if (!note.empty()) notes.push_back(note);
  if (choice.world && (choice.origin.empty() || choice.origin == "world"))
    notes.push_back("the poses are in the frame of " + choice.world->name);
  if (const auto* write = std::get_if<TextOfPoses>(&traits.write)) {
    WriteFileAtomically(path, (*write)(cameras, frame));
  } else {
    for (const auto& [name, text] : std::get<FilesOfPoses>(traits.write)(cameras, frame))
      WriteFileAtomically(path / name, text);
  }
  return notes;
}

}  // namespace volalign

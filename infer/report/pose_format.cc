#include "infer/report/pose_format.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "core/config/config_word.h"
#include "infer/formats/poses/codecs.h"
#include "infer/report/extrinsics.h"

namespace volalign {

namespace {

using namespace poses_internal;

bool IsLivescan(PoseFormat format) {
  return format == PoseFormat::kLivescanKinectV2 || format == PoseFormat::kLivescanAzure;
}

/// The camera whose points LiveScan3D's client of that device transforms.
CameraFromSensor LivescanCamera(PoseFormat format, const PoseFormatOptions& options) {
  if (format == PoseFormat::kLivescanKinectV2) {
    return [](const std::string&) {
      Pose pose = Pose::Identity();
      pose.linear() = KinectV2FromSensor();
      return pose;
    };
  }
  return [&options](const std::string& name) {
    const auto found = options.colour_from_depth.find(name);
    if (found == options.colour_from_depth.end()) {
      throw ConfigError(fmt::format(
          "livescan3d_azure: its points are those of the colour camera, and where that of {0} is "
          "to its depth camera is not known; give the device's raw calibration by "
          "--colour-camera {0}=FILE.json",
          name));
    }
    return found->second;
  };
}

Files ReadFolder(const std::filesystem::path& path, PoseFormat format) {
  const auto wanted = [&](const std::filesystem::path& file) {
    if (IsLivescan(format)) return IsLivescanFile(file.filename().string());
    return format == PoseFormat::kColmap
               ? file.filename() == "cameras.txt" || file.filename() == "images.txt"
               : file.extension() == ".extrinsics";
  };
  Files files;
  std::error_code error;
  for (std::filesystem::directory_iterator it(path, error), end; !error && it != end;
       it.increment(error)) {
    if (wanted(it->path()))
      files[it->path().filename().string()] = ReadFile(it->path(), kMaxResultBytes);
  }
  if (error) throw IoError(fmt::format("{}: {}", path.string(), error.message()));
  return files;
}

/// The sensors of an extrinsics.json that have a pose.
std::vector<SensorPose> ReadPosesOfExtrinsics(const std::filesystem::path& path) {
  std::vector<SensorPose> poses;
  for (const Extrinsics::Sensor& sensor : ReadExtrinsics(path).sensors) {
    if (sensor.structure_from_sensor)
      poses.push_back({sensor.name, *sensor.structure_from_sensor, sensor.intrinsics});
  }
  return poses;
}

/// Of a format that is one text.
struct TextCodec {
  PoseFormat format;
  Poses (*read)(const std::string& text, const std::string& name);
  std::string (*write)(const Poses& poses);
};
constexpr TextCodec kTextCodecs[] = {{PoseFormat::kPoses, ReadPosesJson, WritePosesJson},
                                     {PoseFormat::kOpen3d, ReadOpen3d, WriteOpen3d},
                                     {PoseFormat::kOpen3dLog, ReadOpen3dLog, WriteOpen3dLog},
                                     {PoseFormat::kOpencv, ReadOpencv, WriteOpencv},
                                     {PoseFormat::kRos, ReadRos, WriteRos},
                                     {PoseFormat::kUnity, ReadUnity, WriteUnity},
                                     {PoseFormat::kTum, ReadTum, WriteTum},
                                     {PoseFormat::kCsv, ReadCsv, WriteCsv}};

const TextCodec& CodecOf(PoseFormat format) {
  return *std::find_if(std::begin(kTextCodecs), std::end(kTextCodecs),
                       [&](const TextCodec& codec) { return codec.format == format; });
}

std::vector<SensorPose> ReadAny(const std::filesystem::path& path, PoseFormat format,
                                const PoseFormatOptions& options) {
  if (format == PoseFormat::kVolalign) return ReadPosesOfExtrinsics(path);
  if (IsFolder(format)) {
    const Files files = ReadFolder(path, format);
    if (IsLivescan(format)) return ReadLivescan(files, LivescanCamera(format, options));
    return format == PoseFormat::kColmap ? ReadColmap(files) : ReadVolumetricCapture(files);
  }
  return CodecOf(format).read(ReadFile(path, kMaxResultBytes), path.string());
}

bool HoldsIntrinsics(PoseFormat format) {
  return format != PoseFormat::kOpen3dLog && format != PoseFormat::kRos &&
         format != PoseFormat::kVolumetricCapture && format != PoseFormat::kTum &&
         !IsLivescan(format);
}

/// Throws where the format cannot be written; what it leaves out.
std::vector<std::string> CheckPlace(PoseFormat format, const std::vector<SensorPose>& poses) {
  const bool needs = format == PoseFormat::kOpen3d || format == PoseFormat::kColmap;
  bool intrinsics = false, distortion = false;
  for (const SensorPose& pose : poses) {
    if (needs && !pose.intrinsics)
      throw ConfigError(fmt::format("{} needs intrinsics, and those of \"{}\" are not known",
                                    WordOf(kPoseFormatWords, format), pose.name));
    if ((format == PoseFormat::kVolumetricCapture || IsLivescan(format)) &&
        (pose.name.empty() || pose.name.find('/') != std::string::npos || pose.name[0] == '.'))
      throw ConfigError(fmt::format("\"{}\" is no name of a file", pose.name));
    intrinsics = intrinsics || pose.intrinsics;
    distortion = distortion || (pose.intrinsics && !pose.intrinsics->distortion.empty());
  }
  std::vector<std::string> lost;
  if (intrinsics && !HoldsIntrinsics(format)) lost.push_back("the intrinsics have no place in it");
  if (distortion && format == PoseFormat::kOpen3d)
    lost.push_back(
        "the distortion has no place in it: Open3D's cameras are pinholes, so undistort the "
        "pictures");
  if (format == PoseFormat::kLivescanAzure) {
    lost.push_back(
        "LiveScan3D looks for calibration_SERIAL.txt in its working folder, so a sensor's name has "
        "to be its serial number; clients that keep the number with its final zero look for a file "
        "without .txt: copy it to that name");
  }
  return lost;
}

}  // namespace

bool IsFolder(PoseFormat format) {
  return format == PoseFormat::kColmap || format == PoseFormat::kVolumetricCapture ||
         IsLivescan(format);
}

PoseFormat ParsePoseFormat(const std::string& word) {
  std::vector<std::string> words;
  for (const auto& [known, format] : kPoseFormatWords) {
    if (word == known) return format;
    words.emplace_back(known);
  }
  throw ConfigError(fmt::format("\"{}\" is no format; known are {}", word, fmt::join(words, ", ")));
}

std::vector<SensorPose> ReadPoses(const std::filesystem::path& path, PoseFormat format,
                                  const PoseFormatOptions& options) {
  std::vector<SensorPose> poses = ReadAny(path, format, options);
  if (poses.empty()) throw DataError(fmt::format("{}: no sensor with a pose", path.string()));
  for (const SensorPose& pose : poses) RequirePlainName(pose.name, path.string());
  return poses;
}

std::vector<std::string> WritePoses(const std::filesystem::path& path, PoseFormat format,
                                    const std::vector<SensorPose>& poses,
                                    const PoseFormatOptions& options) {
  if (format == PoseFormat::kVolalign)
    throw ConfigError(
        "only `volalign calibrate` writes an extrinsics.json; --to poses has the "
        "poses and intrinsics alone");
  std::vector<std::string> lost = CheckPlace(format, poses);
  if (!IsFolder(format)) {
    WriteFileAtomically(path, CodecOf(format).write(poses));
    return lost;
  }
  const Files files = IsLivescan(format) ? WriteLivescan(poses, LivescanCamera(format, options))
                      : format == PoseFormat::kColmap ? WriteColmap(poses)
                                                      : WriteVolumetricCapture(poses);
  for (const auto& [name, text] : files) WriteFileAtomically(path / name, text);
  return lost;
}

}  // namespace volalign

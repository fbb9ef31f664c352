#include "tests/fuzz/targets.h"

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/config/config.h"
#include "core/formats/image_io.h"
#include "core/geometry/camera.h"
#include "core/geometry/rig.h"
#include "core/geometry/sensor_kind.h"
#include "core/geometry/structure.h"
#include "core/model/checkpoint_meta.h"
#include "core/nn/safetensors.h"
#include "infer/calib/calibrate.h"
#include "infer/capture/capture.h"
#include "infer/formats/depth_file.h"
#include "infer/formats/intrinsics_file.h"
#include "infer/formats/poses/codecs.h"
#include "infer/formats/recording.h"
#include "infer/report/extrinsics.h"
#include "infer/segment_onnx/onnx_network.h"
#include "tests/core/base/temp_folder.h"

namespace volalign {
namespace {

namespace poses = poses_internal;

constexpr std::size_t kMostMessageBytes = 2000;

/// A file of these bytes, over the one before it.
std::filesystem::path FileOf(const std::string& name, const std::string& bytes) {
  static const TempFolder folder;
  return folder.Write(name, bytes);
}

/// `NAME, line feed, content` for each file of a folder, form feeds between them.
poses::Files FolderOf(const std::string& bytes) {
  poses::Files files;
  for (const std::string& part : Split(bytes, '\f')) {
    const std::size_t end = part.find('\n');
    if (end != std::string::npos) files[part.substr(0, end)] = part.substr(end + 1);
  }
  return files;
}

using RecordingReader = decltype(formats_internal::ReadBagRecording);

/// Within what ten seconds under the sanitizers allow.
void ReadBy(RecordingReader* read, const std::string& name, const std::string& bytes) {
  ReadBudget budget(std::uint64_t{1} << 22);
  const std::filesystem::path path = FileOf(name, bytes);
  read(path, path.string(), 2, &budget);
}

}  // namespace

const std::vector<FuzzTarget>& FuzzTargets() {
  using Bytes = const std::string&;
  using formats_internal::DecodeNpy, formats_internal::ReadExr, formats_internal::ReadTiff;
  static const std::vector<FuzzTarget> targets = {
      {"safetensors", [](Bytes bytes) { ReadSafetensors(bytes); }},
      {"metadata", [](Bytes bytes) { MetaFromJson(bytes); }},
      {"onnx", [](Bytes bytes) { ReadOnnxNetwork(bytes); }},
      {"tiff", [](Bytes bytes) { ReadTiff(FileOf("a.tif", bytes)); }},
      {"exr", [](Bytes bytes) { ReadExr(FileOf("a.exr", bytes), bytes); }},
      {"npy", [](Bytes bytes) { DecodeNpy(bytes, "file"); }},
      {"image", [](Bytes bytes) { DecodeDepth(bytes, "file"); }},
      {"intrinsics",
       [](Bytes bytes) {
         if (LooksLikeIntrinsics(bytes)) ParseIntrinsicsText(bytes, "file", {320, 288});
       }},
      {"db3", [](Bytes bytes) { ReadBy(formats_internal::ReadRos2Recording, "a.db3", bytes); }},
      {"mkv", [](Bytes bytes) { ReadBy(formats_internal::ReadMkvRecording, "a.mkv", bytes); }},
      {"bag", [](Bytes bytes) { ReadBy(formats_internal::ReadBagRecording, "a.bag", bytes); }},
      {"mcap", [](Bytes bytes) { ReadBy(formats_internal::ReadMcapRecording, "a.mcap", bytes); }},
      {"structure", [](Bytes bytes) { ReadStructure(FileOf("a.yaml", bytes).string()); }},
      {"capture",
       [](Bytes bytes) {
         FileOf("d.pgm", "P2\n2 2\n65535\n1000 1100 1200 0\n");
         ReadCapture(FileOf("capture.json", bytes));
       }},
      {"extrinsics", [](Bytes bytes) { ReadExtrinsics(FileOf("extrinsics.json", bytes)); }},
      {"options",
       [](Bytes bytes) { ReadConfig<CalibrateOptions>(ConfigSource::FromString(bytes, "file")); }},
      {"pool",
       [](Bytes bytes) {
         ReadIntrinsicsPool(FileOf("pool.yaml", bytes).string());
         ParseSensorKinds(bytes, "file");
       }},
      {"rig", [](Bytes bytes) { ReadRig(ConfigSource::FromString(bytes, "file")); }},
      {"poses_json", [](Bytes bytes) { poses::ReadPosesJson(bytes, "file"); }},
      {"open3d", [](Bytes bytes) { poses::ReadOpen3d(bytes, "file"); }},
      {"unity", [](Bytes bytes) { poses::ReadUnity(bytes, "file"); }},
      {"open3d_log", [](Bytes bytes) { poses::ReadOpen3dLog(bytes, "file"); }},
      {"tum", [](Bytes bytes) { poses::ReadTum(bytes, "file"); }},
      {"csv", [](Bytes bytes) { poses::ReadCsv(bytes, "file"); }},
      {"opencv", [](Bytes bytes) { poses::ReadOpencv(bytes, "file"); }},
      {"ros", [](Bytes bytes) { poses::ReadRos(bytes, "file"); }},
      {"cwipc", [](Bytes bytes) { poses::ReadCwipc(bytes, "file"); }},
      {"volumetric", [](Bytes bytes) { poses::ReadVolumetricCapture(FolderOf(bytes)); }},
      {"livescan", [](Bytes bytes) { poses::ReadLivescan(FolderOf(bytes)); }},
      {"colmap", [](Bytes bytes) { poses::ReadColmap(FolderOf(bytes)); }}};
  return targets;
}

namespace {

std::string MessageOf(const FuzzTarget& target, const std::string& bytes) {
  try {
    target.read(bytes);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace

std::string ReadFuzzInput(const FuzzTarget& target, const std::string& bytes) {
  std::string message = MessageOf(target, bytes);
  const auto require = [&](bool holds, const char* what) {
    if (!holds) throw std::logic_error(fmt::format("a message {}: {}", what, message));
  };
  require(message.size() < kMostMessageBytes, "of 2000 bytes or more");
  require(IsUtf8(message), "that is not UTF-8");
  require(MessageOf(target, bytes) == message, "that is another one in the second reading");
  return message;
}

}  // namespace volalign

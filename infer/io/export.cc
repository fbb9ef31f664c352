#include "infer/io/export.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>
#include <thread>

#include "core/error.h"
#include "core/file_util.h"
#include "core/image_io.h"
#include "core/parallel_for.h"
#include "core/picture.h"
#include "core/strict_json.h"
#include "infer/io/capture.h"
#include "infer/io/pictures.h"
#include "infer/io/ply.h"

namespace volalign {

namespace {

/// What a sensor adds to the pictures and clouds of all.
struct SensorFiles {
  RgbImage picture;
  std::vector<AlignedPoint> cloud;
};

SensorFiles WriteSensor(const std::filesystem::path& folder, const SensorResult& sensor,
                        const Structure& built, int turns) {
  const std::string png = sensor.name + ".png";
  WritePng(folder / "labels" / png, sensor.segmentation.labels);
  WritePng(folder / "confidence" / png, ConfidenceImage(sensor.segmentation.confidence));
  SensorFiles written{SensorPicture(sensor, built, turns), AlignedPoints(sensor, built)};
  WritePng(folder / "pictures" / png, written.picture);
  if (sensor.structure_from_sensor) {
    WritePly(folder / "clouds" / (sensor.name + ".ply"), written.cloud);
  }
  return written;
}

/// The sensors of the run that `folder` has the results of. None where its extrinsics.json is none
/// of volalign's, of whatever version.
std::vector<std::string> EarlierSensors(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / "extrinsics.json";
  std::vector<std::string> names;
  if (!std::filesystem::exists(path)) return names;
  try {
    const nlohmann::json document = ParseStrictJson(ReadFile(path), path.string());
    const JsonObject root(document, path.string());
    if (root.Text("format").rfind("volalign.extrinsics/", 0) != 0) return names;
    // A name that leads elsewhere is none that volalign wrote.
    for (const std::string& name : root.Child("sensors").Keys()) {
      if (IsFileName(name)) names.push_back(name);
    }
  } catch (const Error&) {
    names.clear();
  }
  return names;
}

void RemoveFile(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(std::filesystem::symlink_status(path, error))) return;
  if (!std::filesystem::remove(path, error)) {
    throw IoError(fmt::format("cannot remove {}, which is of an earlier run: {}", path.string(),
                              error.message()));
  }
}

/// Removes what an earlier run wrote and this one does not.
void RemoveEarlierFiles(const std::filesystem::path& folder,
                        const std::vector<SensorResult>& sensors) {
  for (const std::string& name : EarlierSensors(folder)) {
    const auto now = std::find_if(sensors.begin(), sensors.end(),
                                  [&](const SensorResult& sensor) { return sensor.name == name; });
    if (now == sensors.end()) {
      for (const char* images : {"labels", "confidence", "pictures"}) {
        RemoveFile(folder / images / (name + ".png"));
      }
    }
    if (now == sensors.end() || !now->structure_from_sensor) {
      RemoveFile(folder / "clouds" / (name + ".ply"));
    }
  }
}

}  // namespace

void PrepareFolder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (!error && ::access(folder.c_str(), W_OK) != 0) error = {errno, std::generic_category()};
  if (!error) return;
  throw IoError(fmt::format("cannot write into the folder {}: {}; choose another one",
                            folder.string(), error.message()));
}

void WriteCalibration(const std::filesystem::path& folder, const CalibrationResult& result,
                      const std::vector<SensorFrame>& frames, const Structure& structure,
                      const ExtrinsicsSource& source) {
  const Structure& built = result.built.boxes().empty() ? structure : result.built;
  const std::vector<int> turns = UprightTurnsOf(result.sensors);
  std::vector<SensorFiles> written(result.sensors.size());
  const int threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  ParallelFor(result.sensors.size(), threads, [&](std::size_t i) {
    written[i] = WriteSensor(folder, result.sensors[i], built, turns[i]);
  });
  std::vector<RgbImage> pictures;
  std::vector<AlignedPoint> merged;
  for (SensorFiles& files : written) {
    pictures.push_back(std::move(files.picture));
    merged.insert(merged.end(), files.cloud.begin(), files.cloud.end());
  }
  WritePng(folder / "pictures" / "overview.png", Montage(pictures, pictures.size() > 3 ? 2 : 1));
  WritePly(folder / "clouds" / "merged.ply", merged);
  RemoveEarlierFiles(folder, result.sensors);
  WriteExtrinsics(folder / "extrinsics.json", MakeExtrinsics(result, frames, structure, source));
}

}  // namespace volalign

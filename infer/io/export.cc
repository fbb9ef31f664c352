#include "infer/io/export.h"

#include <algorithm>
#include <string>
#include <thread>

#include "core/image_io.h"
#include "core/parallel_for.h"
#include "core/picture.h"
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

}  // namespace

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
  WriteExtrinsics(folder / "extrinsics.json", MakeExtrinsics(result, frames, structure, source));
}

}  // namespace volalign

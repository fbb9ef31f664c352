#include "render/capture_writer.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/file_util.h"
#include "core/image_io.h"
#include "core/picture.h"
#include "core/structure_gltf.h"

namespace volalign {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kDepthScale = 0.001;  // m a step
constexpr double kPictureNear = 0.5;   // m, contact sheets
constexpr double kPictureFar = 6.0;

void WriteJson(const std::filesystem::path& path, const Json& json) {
  WriteFileAtomically(path, json.dump(2) + "\n");
}

}  // namespace

nlohmann::ordered_json ToJson(const Intrinsics& k) {
  return {{"width", k.width}, {"height", k.height},        {"fx", k.fx}, {"fy", k.fy}, {"cx", k.cx},
          {"cy", k.cy},       {"distortion", k.distortion}};
}

void AppendPictures(const DepthImage& clean, const DepthImage& depth, const LabelImage& labels,
                    const Pose& structure_from_sensor, std::vector<RgbImage>* pictures) {
  const int turns = UprightTurns(structure_from_sensor);
  pictures->push_back(Turn(ColourDepth(clean, kPictureNear, kPictureFar), turns));
  pictures->push_back(Turn(ColourDepth(depth, kPictureNear, kPictureFar), turns));
  pictures->push_back(Turn(ColourLabels(labels), turns));
}

void WriteCapture(const std::filesystem::path& dir, const RigCapture& capture) {
  Json json{{"format", "volalign.capture/1"},
            {"depth_scale", kDepthScale},
            {"structure", "structure.glb"},
            {"sensors", Json::array()}};
  Json ground_truth;
  std::vector<RgbImage> pictures;
  for (const CapturedSensor& sensor : capture.sensors) {
    const std::string depth_name = sensor.name + "_Depth.png";
    WritePng(dir / depth_name, FromMetres(sensor.depth, kDepthScale));
    WritePng(dir / (sensor.name + "_labels.png"), sensor.labels);
    json["sensors"].push_back({{"name", sensor.name},
                               {"sensor", sensor.sensor},
                               {"depth", depth_name},
                               {"intrinsics", ToJson(sensor.stated_intrinsics)}});
    ground_truth[sensor.name] = ToRows(sensor.structure_from_sensor);
    AppendPictures(sensor.depth_clean, sensor.depth, sensor.labels, sensor.structure_from_sensor,
                   &pictures);
  }
  if (capture.structure_present) json["ground_truth"] = ground_truth;
  WriteStructureGlb(dir / "structure.glb", capture.structure);
  WritePng(dir / "contact_sheet.png", Montage(pictures, pictures.size() > 9 ? 6 : 3));
  WriteJson(dir / "capture.json", json);
}

}  // namespace volalign

#include "render/capture_writer.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/file_util.h"
#include "core/image_io.h"
#include "core/picture.h"
#include "core/structure_gltf.h"
#include "render/depth_renderer.h"

namespace volalign {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kDepthScale = 0.001;  // m a step
constexpr double kPictureNear = 0.5;   // m, contact sheets
constexpr double kPictureFar = 6.0;
constexpr int kSheetSamples = 24;

Json ToJson(const Intrinsics& k) {
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

void WriteJson(const std::filesystem::path& path, const Json& json) {
  WriteFileAtomically(path, json.dump(2) + "\n");
}

}  // namespace

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
    json["sensors"].push_back(
        {{"name", sensor.name}, {"depth", depth_name}, {"intrinsics", ToJson(sensor.intrinsics)}});
    ground_truth[sensor.name] = ToRows(sensor.structure_from_sensor);
    AppendPictures(sensor.depth_clean, sensor.depth, sensor.labels, sensor.structure_from_sensor,
                   &pictures);
  }
  if (capture.structure_present) json["ground_truth"] = ground_truth;
  WriteStructureGlb(dir / "structure.glb", capture.structure);
  WritePng(dir / "contact_sheet.png", Montage(pictures, pictures.size() > 9 ? 6 : 3));
  WriteJson(dir / "capture.json", json);
}

void WriteSamples(const std::filesystem::path& dir, const SampleContext& context,
                  DepthRenderer& renderer, std::uint64_t seed, std::uint64_t first_index,
                  int count) {
  Json json{{"format", "volalign.samples/1"},
            {"seed", seed},
            {"depth_scale", kDepthScale},
            {"structure", context.structure.name()},
            {"samples", Json::array()}};
  std::vector<RgbImage> pictures;
  for (int i = 0; i < count; ++i) {
    const Sample sample =
        Synthesize(context, renderer, seed, first_index + static_cast<std::uint64_t>(i));
    const std::string stem = fmt::format("{:08}", sample.index);
    WritePng(dir / (stem + "_depth.png"), FromMetres(sample.depth, kDepthScale));
    WritePng(dir / (stem + "_labels.png"), sample.labels);
    Json offsets = Json::array();
    for (const Pose& offset : sample.box_offsets) offsets.push_back(ToRows(offset));
    json["samples"].push_back({{"index", sample.index},
                               {"depth", stem + "_depth.png"},
                               {"labels", stem + "_labels.png"},
                               {"sensor", sample.sensor},
                               {"intrinsics", ToJson(sample.intrinsics)},
                               {"structure_from_sensor", ToRows(sample.structure_from_sensor)},
                               {"box_offsets", offsets},
                               {"size_scale", sample.size_scale}});
    if (i < kSheetSamples) {
      AppendPictures(sample.depth_clean, sample.depth, sample.labels, sample.structure_from_sensor,
                     &pictures);
    }
  }
  if (!pictures.empty()) {
    WritePng(dir / "contact_sheet.png", Montage(pictures, pictures.size() > 9 ? 6 : 3));
  }
  WriteJson(dir / "index.json", json);
}

}  // namespace volalign

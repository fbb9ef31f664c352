#include "render/capture_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/file_util.h"
#include "core/formats/image_io.h"
#include "core/geometry/structure.h"
#include "core/json/json_archive.h"
#include "core/plot/picture.h"
#include "core/plot/picture_text.h"

namespace volalign {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kPictureNear = 0.5;  // m, contact sheets
constexpr double kPictureFar = 6.0;

}  // namespace

RgbImage SheetPicture(const std::string& name, const DepthImage& clean, const DepthImage& depth,
                      const LabelImage& labels, const Pose& structure_from_sensor) {
  const int turns = UprightTurns(structure_from_sensor);
  const auto upright = [&](const RgbImage& picture, const char* what) {
    return Captioned(Turn(picture, turns), name + " " + what);
  };
  return Shelves({upright(ColourDepth(clean, kPictureNear, kPictureFar), "exact"),
                  upright(ColourDepth(depth, kPictureNear, kPictureFar), "measured"),
                  upright(ColourLabels(labels), "labels")},
                 3);
}

void WriteContactSheet(const std::filesystem::path& path, const std::vector<RgbImage>& pictures) {
  constexpr int kMargin = 6, kWidest = 400;
  const RgbImage sheet = Shelves(pictures, pictures.size() > 3 ? 2 : 1);
  RgbImage with_scale(sheet.width(), sheet.height() + kScaleHeight + kTextHeight + 3 * kMargin,
                      kPaper);
  for (int v = 0; v < sheet.height(); ++v) {
    for (int u = 0; u < sheet.width(); ++u) with_scale(u, v) = sheet(u, v);
  }
  const int top = sheet.height() + kMargin;
  DrawText(&with_scale, kMargin, top, "depth, m (black: no measurement)", kInk);
  DrawScale(
      &with_scale, kMargin, top + kTextHeight + kMargin / 2,
      std::min(kWidest, sheet.width() - 2 * kMargin), DepthColour,
      {fmt::format("{:.1f}", kPictureNear), fmt::format("{:.2f}", (kPictureNear + kPictureFar) / 2),
       fmt::format("{:.1f}", kPictureFar)});
  WritePng(path, with_scale);
}

void WriteCapture(const std::filesystem::path& dir, const RigCapture& capture,
                  const std::string& renderer) {
  Json json{{"format", "volalign.capture/1"},
            {"depth_scale", kDepthScale},
            {"structure", "structure.yaml"},
            {"sensors", Json::array()}};
  Json ground_truth;
  std::vector<RgbImage> pictures;
  for (const CapturedSensor& sensor : capture.sensors) {
    const std::string depth_name = sensor.name + "_depth.png";
    const Json intrinsics = DescribedJson(sensor.stated_intrinsics, sensor.name);
    WritePng(dir / depth_name, FromMetres(sensor.depth, kDepthScale));
    WritePng(dir / (sensor.name + "_labels.png"), sensor.labels);
    WriteFileAtomically(dir / (sensor.name + "_intrinsics.json"), intrinsics.dump(2) + "\n");
    json["sensors"].push_back({{"name", sensor.name},
                               {"sensor", sensor.sensor},
                               {"depth", depth_name},
                               {"renderer", renderer},
                               {"intrinsics", intrinsics}});
    ground_truth[sensor.name] = ToRows(sensor.structure_from_sensor);
    pictures.push_back(SheetPicture(sensor.name, sensor.depth_clean, sensor.depth, sensor.labels,
                                    sensor.structure_from_sensor));
  }
  if (capture.structure_present) json["ground_truth"] = ground_truth;
  WriteFileAtomically(dir / "structure.yaml", StructureYaml(capture.structure));
  WriteContactSheet(dir / "contact_sheet.png", pictures);
  WriteFileAtomically(dir / "capture.json", json.dump(2) + "\n");
}

}  // namespace volalign

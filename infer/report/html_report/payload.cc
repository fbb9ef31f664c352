#include "infer/report/html_report/payload.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/base/text.h"
#include "core/config/config.h"
#include "core/plot/picture.h"
#include "infer/calib/calibrate.h"
#include "infer/report/html_report/encode.h"

namespace volalign {

namespace {

using Json = nlohmann::ordered_json;

constexpr int kScaleStops = 17;  // of a colour scale

Json ToJson(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

/// Labels 1 and up: name and colour.
Json Labels(const Structure& structure) {
  Json labels = Json::array();
  for (int label = 1; label < structure.num_classes(); ++label) {
    labels.push_back({{"id", label},
                      {"name", structure.SideOfLabel(label).name},
                      {"colour", HexColour(LabelColour(label))}});
  }
  return labels;
}

template <class Colour>
Json Scale(Colour colour, double from, double to) {
  Json stops = Json::array();
  for (int i = 0; i < kScaleStops; ++i)
    stops.push_back(HexColour(colour(from + (to - from) * i / (kScaleStops - 1))));
  return stops;
}

/// To 0.1 mm.
Json Rounded(const Eigen::Vector3d& p) { return ToJson((1e4 * p).array().round() / 1e4); }

Json CornersOf(const std::vector<std::array<Eigen::Vector3d, 3>>& triangles) {
  Json corners = Json::array();
  for (const auto& triangle : triangles)
    for (const Eigen::Vector3d& corner : triangle) corners.push_back(Rounded(corner));
  return corners;
}

/// The ends of an outline's borders, structure frame.
Json BorderEnds(const Side& side) {
  Json ends = Json::array();
  for (const Outline::Border& border : side.outline->borders) {
    for (const Eigen::Vector2d& end : {border.from, border.to}) {
      ends.push_back(Rounded(side.centre +
                             side.outline_scale * (end.x() * side.axis_u + end.y() * side.axis_v)));
    }
  }
  return ends;
}

Json Boxes(const Structure& structure) {
  Json boxes = Json::array();
  for (std::size_t b = 0; b < structure.boxes().size(); ++b) {
    const Box& box = structure.boxes()[b];
    std::vector<std::vector<std::array<Eigen::Vector3d, 3>>> triangles;
    if (box.mesh) triangles = box.TrianglesBySide();
    Json sides = Json::array();
    for (const Side& side : structure.sides()) {
      if (side.box != static_cast<int>(b)) continue;
      sides.push_back({{"name", side.name},
                       {"label", side.label},
                       {"centre", ToJson(side.centre)},
                       {"u", ToJson(side.half_u * side.axis_u)},
                       {"v", ToJson(side.half_v * side.axis_v)}});
      if (!box.mesh) continue;
      sides.back()["triangles"] = CornersOf(triangles[static_cast<std::size_t>(side.index)]);
      sides.back()["borders"] = BorderEnds(side);
    }
    boxes.push_back({{"name", box.name},
                     {"size_m", ToJson(box.size)},
                     {"structure_from_box", ToRows(box.structure_from_box)},
                     {"sides", std::move(sides)}});
  }
  return boxes;
}

/// Limits of a weak sensor, by the options of the calibration.
Json Limits(const std::string& options) {
  const VerdictOptions verdict =
      ReadConfig<CalibrateOptions>(ConfigSource::FromString(options, "options")).verdict;
  return {{"rms_m", verdict.weak_rms_m},
          {"sigma_position_m", verdict.weak_sigma_position_m},
          {"sigma_rotation_deg", verdict.weak_sigma_rotation_deg},
          {"inlier_share", verdict.weak_inlier_share},
          {"label_iou", verdict.weak_label_iou}};
}

std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines = Split(text, '\n');
  lines.erase(std::remove(lines.begin(), lines.end(), ""), lines.end());
  return lines;
}

}  // namespace

Json ReportFrameJson(const ReportFrame& frame) {
  const FramePanels& panels = frame.panels;
  Json json = {{"sensor", frame.sensor},          {"width", panels.depth.width()},
               {"height", panels.depth.height()}, {"near_m", panels.near_m},
               {"far_m", panels.far_m},           {"labels", panels.shown_labels}};
  Json& pictures = json["pictures"] = Json::object();
  pictures["depth"] = PngDataUri(panels.depth);
  pictures["labels"] = PngDataUri(panels.labels);
  if (!panels.edges.empty()) pictures["edges"] = PngDataUri(panels.edges);
  if (!panels.residual.empty()) pictures["residual"] = PngDataUri(panels.residual);
  Json& sides = json["sides"] = Json::array();
  for (const SideFit& side : panels.sides) {
    sides.push_back({{"label", side.label},
                     {"points", side.points},
                     {"mean_m", side.mean_m},
                     {"rms_m", side.rms_m}});
  }
  if (!frame.cloud.empty()) {
    EncodedCloud cloud = EncodeCloud(frame.cloud);
    json["cloud"] = {{"count", cloud.count},
                     {"positions", std::move(cloud.positions)},
                     {"labels", std::move(cloud.labels)},
                     {"residuals", std::move(cloud.residuals)}};
  }
  return json;
}

Json ReportPayload(const Extrinsics& extrinsics, const std::vector<ReportCapture>& captures,
                   const ReportRig& rig, const ReportRun& run) {
  Json payload;
  payload["format"] = "volalign.report/1";
  payload["command"] = run.command;
  payload["next"] = run.next;
  if (!run.check.empty()) {
    payload["check"] = {{"sentences", run.checked}, {"file", Json::parse(run.check)}};
  }
  payload["options"] = run.options;
  payload["notes"] = Lines(rig.notes);
  payload["advice"] = rig.advice;
  payload["from_above"] = rig.from_above;
  payload["twins"] = rig.alternatives;
  payload["decisive_odds"] = kDecisiveOdds;
  payload["limits"] = Limits(run.options);
  payload["extrinsics"] = ExtrinsicsJson(extrinsics, "report.html");
  payload["labels"] = captures.empty() ? Json::array() : Labels(captures[0].built);
  payload["depth_colours"] = Scale(DepthColour, 0, 1);
  payload["residual_colours"] = Scale(SignedColour, -1, 1);
  payload["residual_scale_m"] = kResidualScale;
  payload["point_step_m"] = kPointStep;
  payload["residual_step_m"] = kResidualStep;
  payload["no_residual"] = kNoResidual;
  Json& parts = payload["stills"] = Json::array();
  for (const ReportCapture& capture : captures) {
    parts.push_back(
        {{"name", capture.name}, {"boxes", Boxes(capture.built)}, {"frames", capture.frames}});
  }
  return payload;
}

}  // namespace volalign

#include "infer/report/html_report/payload.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "core/config/config.h"
#include "core/formats/image_io.h"
#include "core/geometry/visibility.h"
#include "core/plot/picture.h"
#include "core/plot/rig_from_above.h"
#include "infer/calib/calibrate.h"
#include "infer/checks/verdict.h"
#include "infer/report/html_report/assets.h"
#include "infer/report/panels.h"

namespace volalign {

namespace {

void AppendInt16(std::string* bytes, double steps) {
  const auto value = static_cast<std::int16_t>(std::lround(std::clamp(steps, -32767.0, 32767.0)));
  const auto bits = static_cast<std::uint16_t>(value);
  *bytes += static_cast<char>(bits & 0xff);
  *bytes += static_cast<char>(bits >> 8);
}

/// Takes one point of each of `most` equal stretches of the list. Its place differs from stretch to
/// stretch, so that rows and columns of pixels leave no pattern.
void TakeEvenly(const std::vector<const AlignedPoint*>& points, std::size_t most,
                std::vector<AlignedPoint>* taken) {
  const std::size_t count = std::min(most, points.size());
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t begin = i * points.size() / count, end = (i + 1) * points.size() / count;
    constexpr std::size_t kScatter = 2654435761;  // Knuth's multiplicative hash
    taken->push_back(*points[begin + (i * kScatter >> 16) % (end - begin)]);
  }
}

}  // namespace

std::string PngDataUri(const RgbImage& picture) {
  return "data:image/png;base64," + Base64(EncodePalettePng(picture));
}

std::string HexColour(Rgb colour) {
  return fmt::format("#{:02x}{:02x}{:02x}", colour.r, colour.g, colour.b);
}

EncodedCloud EncodeCloud(const std::vector<AlignedPoint>& points) {
  std::string positions, labels, residuals;
  for (const AlignedPoint& point : points) {
    for (int i = 0; i < 3; ++i) AppendInt16(&positions, point.p[i] / kPointStep);
    labels += static_cast<char>(point.label);
    const bool known = std::isfinite(point.side_residual);
    const double steps = known ? std::clamp(point.side_residual / kResidualStep, -127.0, 127.0)
                               : static_cast<double>(kNoResidual);
    residuals += static_cast<char>(static_cast<std::int8_t>(std::lround(steps)));
  }
  return {points.size(), Base64(positions), Base64(labels), Base64(residuals)};
}

std::vector<AlignedPoint> ThinCloud(const std::vector<AlignedPoint>& points, std::size_t most) {
  if (points.size() <= most) return points;
  constexpr double kLabelledShare = 0.6;
  std::vector<const AlignedPoint*> labelled, others;
  for (const AlignedPoint& point : points) (point.label > 0 ? labelled : others).push_back(&point);
  const auto share = static_cast<std::size_t>(kLabelledShare * static_cast<double>(most));
  const std::size_t of_others = std::min(others.size(), most - std::min(labelled.size(), share));
  std::vector<AlignedPoint> thinned;
  TakeEvenly(labelled, most - of_others, &thinned);
  TakeEvenly(others, of_others, &thinned);
  return thinned;
}

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

Json ReportFrameJson(const std::string& sensor, const FramePanels& panels,
                     const std::vector<AlignedPoint>& points) {
  Json json = {
      {"sensor", sensor},        {"width", panels.depth.width()}, {"height", panels.depth.height()},
      {"near_m", panels.near_m}, {"far_m", panels.far_m},         {"labels", panels.shown_labels}};
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
  if (!points.empty()) {
    EncodedCloud cloud = EncodeCloud(points);
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

namespace {

const SensorAlternative* Find(const RigAlternative& alternative, const std::string& name) {
  const auto found =
      std::find_if(alternative.sensors.begin(), alternative.sensors.end(),
                   [&](const SensorAlternative& sensor) { return sensor.name == name; });
  return found == alternative.sensors.end() ? nullptr : &*found;
}

/// 1 - intersection over union of the pixels that show the structure at either pose.
double OutlinesDiffer(const SensorView& view, const Structure& structure, const Pose& a,
                      const Pose& b) {
  const DepthImage at_a = CastView(structure, view.rays, a).depth,
                   at_b = CastView(structure, view.rays, b).depth;
  int both = 0, either = 0;
  for (std::size_t i = 0; i < at_a.size(); ++i) {
    both += at_a[i] > 0 && at_b[i] > 0;
    either += at_a[i] > 0 || at_b[i] > 0;
  }
  return either > 0 ? 1 - static_cast<double>(both) / either : 0;
}

}  // namespace

std::string PlacedFromAbove(const std::vector<FrameResult>& sensors, const Structure& built,
                            const RigAlternative* alternative) {
  std::vector<SensorFromAbove> placed;
  for (const FrameResult& sensor : sensors) {
    if (!sensor.structure_from_sensor) continue;
    const SensorAlternative* other = alternative ? Find(*alternative, sensor.name) : nullptr;
    SensorFromAbove from_above;
    from_above.name = sensor.name;
    from_above.intrinsics = sensor.intrinsics;
    from_above.structure_from_sensor =
        other ? other->structure_from_sensor : *sensor.structure_from_sensor;
    const Eigen::Vector3d at = from_above.structure_from_sensor.translation();
    const double distance = std::hypot(at.x(), at.z()), height = at.y() - built.FloorHeight();
    const double azimuth = std::fmod(std::atan2(at.z(), at.x()) / kDegree + 360, 360);
    from_above.note = fmt::format("{:.2f} m, {:.2f} m high", distance, height);
    from_above.title = fmt::format(
        "{}: {:.2f} m from the structure's origin, horizontally, at {:.0f}° from x towards z; "
        "{:.2f} m above the floor",
        sensor.name, distance, azimuth, height);
    if (!alternative && sensor.covariance.allFinite()) {
      from_above.covariance =
          PositionCovariance(from_above.structure_from_sensor, sensor.covariance);
      from_above.title += fmt::format(
          "; uncertainty {:.1f} mm (one standard deviation, worst direction)",
          1000 * LargestSigmaPosition(from_above.structure_from_sensor, sensor.covariance));
    }
    const bool weak = alternative ? other != nullptr : sensor.status == SensorStatus::kWeak;
    from_above.colour = weak ? kOrange : kBlue;
    placed.push_back(std::move(from_above));
  }
  LegendFromAbove legend{{{kBlue, "ok"}, {kOrange, "weak"}},
                         "by each name: distance from the structure's origin, height above the "
                         "floor"};
  if (alternative) legend.colours = {{kBlue, "as reported"}, {kOrange, "elsewhere"}};
  return RigFromAbove(built, placed, legend);
}

nlohmann::ordered_json AlternativeJson(const RigAlternative& alternative,
                                       const std::vector<FrameResult>& sensors,
                                       const std::vector<FrameResult>& of_capture,
                                       const Structure& built, const Pose& first_from_placement) {
  nlohmann::ordered_json json = {{"from_above", PlacedFromAbove(sensors, built, &alternative)}};
  nlohmann::ordered_json& frames = json["frames"] = nlohmann::ordered_json::array();
  const std::vector<int> turns = UprightTurnsOf(of_capture);
  for (std::size_t i = 0; i < of_capture.size(); ++i) {
    const FrameResult& sensor = of_capture[i];
    const SensorAlternative* other = Find(alternative, sensor.name);
    if (!other || !sensor.structure_from_sensor) continue;
    const Pose pose = first_from_placement.inverse() * other->structure_from_sensor;
    const RgbImage edges = EdgesPanel(sensor, built, pose, turns[i]);
    frames.push_back({{"sensor", sensor.name},
                      {"width", edges.width()},
                      {"height", edges.height()},
                      {"picture", PngDataUri(edges)},
                      {"outlines_differ",
                       OutlinesDiffer(sensor.view, built, *sensor.structure_from_sensor, pose)}});
  }
  return json;
}

namespace {

/// JSON for a script element: without "</script>" and "<!--".
std::string ForScript(const nlohmann::ordered_json& payload) {
  const std::string text =
      payload.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  return fmt::format("{}", fmt::join(Split(text, '<'), "\\u003c"));
}

}  // namespace

std::string ReportPage(const nlohmann::ordered_json& payload) {
  namespace assets = report_assets;
  const std::vector<std::pair<std::string, std::string>> parts = {
      {"{{style}}", assets::kStyle},
      {"{{three}}", std::string(assets::kThree) + "\n" + assets::kOrbitControls},
      {"{{payload}}", ForScript(payload)},
      {"{{scripts}}", std::string(assets::kFormatScript) + assets::kTablesScript +
                          assets::kFramesScript + assets::kSceneScript + assets::kViewerScript +
                          assets::kMainScript}};
  // From left to right, so that inserted text is not searched.
  const std::string page = assets::kPage;
  std::string filled;
  std::size_t at = 0;
  for (const auto& [mark, text] : parts) {
    const std::size_t found = page.find(mark, at);
    if (found == std::string::npos) throw Error("report.html has no " + mark);
    filled.append(page, at, found - at);
    filled += text;
    at = found + mark.size();
  }
  return filled.append(page, at, std::string::npos);
}

}  // namespace volalign

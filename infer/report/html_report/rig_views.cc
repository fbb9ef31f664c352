#include "infer/report/html_report/rig_views.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/geometry/visibility.h"
#include "core/plot/rig_from_above.h"
#include "infer/checks/verdict.h"
#include "infer/report/html_report/encode.h"
#include "infer/report/panels.h"

namespace volalign {

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

}  // namespace volalign

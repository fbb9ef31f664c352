#include "infer/report/report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>
#include <vector>

#include "infer/checks/verdict.h"
#include "infer/refine/refine.h"
#include "infer/report/sensors_table.h"

namespace volalign {

namespace {

/// A line with the largest distance of two sensors' points and the least certain pair.
std::string Overlaps(const CalibrationResult& result) {
  if (result.pairs.empty()) return "";
  std::size_t overlapping = 0;
  PairResult apart, open;
  apart.rms_m = open.sigma_m = 0;
  for (const PairResult& pair : result.pairs) {
    overlapping += pair.overlaps() ? 1 : 0;
    if (pair.rms_m > apart.rms_m) apart = pair;
    if (pair.sigma_m > open.sigma_m) open = pair;
  }
  std::string summary = fmt::format("{} of {} pair{} of sensors overlap", overlapping,
                                    result.pairs.size(), result.pairs.size() == 1 ? "" : "s");
  if (overlapping > 0) {
    summary += fmt::format(": their points are at most {:.1f} mm RMS apart ({:.1f} predicted)",
                           1000 * apart.rms_m, 1000 * apart.predicted_rms_m);
  }
  if (open.sigma_m > 0) {
    summary += fmt::format(
        ". The uncertainty of their places relative to each other is {:.1f} mm (one standard "
        "deviation) or less",
        1000 * open.sigma_m);
  }
  return summary + '\n';
}

std::string SensorTable(const std::vector<FrameResult>& sensors) {
  const bool truth = std::any_of(sensors.begin(), sensors.end(), [](const FrameResult& sensor) {
    return sensor.error.has_value();
  });
  std::string text = FormatTable(SensorsTable(sensors), TableFormat::kText);
  text +=
      "initial: source of the initial pose. sides: number of sides that were found\nrms: distance "
      "of labelled points within 10 cm of the structure from it\nsigma: one standard deviation, in "
      "the worst direction and about the worst axis\ninliers: share of labelled points on the "
      "structure";
  if (truth) text += "\nerror: distance from the capture's ground truth";
  return text + '\n';
}

/// Both poses of a sensor that disagrees with the others.
std::string BothPoses(const FrameResult& sensor) {
  const auto place = [](const Pose& pose) {
    const Eigen::Vector3d& t = pose.translation();
    return fmt::format("({:.4f}, {:.4f}, {:.4f}) m", t.x(), t.y(), t.z());
  };
  const PoseError apart = ComparePoses(*sensor.together, *sensor.structure_from_sensor);
  return fmt::format(
      "{} stands at {} by its own picture, and this pose is reported. With the other sensors it "
      "would stand at {}, {:.1f} mm and {:.2f} deg from there (together in extrinsics.json)\n",
      sensor.name, place(*sensor.structure_from_sensor), place(*sensor.together),
      1000 * apart.translation_m, apart.rotation_deg);
}

std::string BothPosesOf(const std::vector<FrameResult>& sensors) {
  std::string text;
  for (const FrameResult& sensor : sensors) {
    if (sensor.together) text += BothPoses(sensor);
  }
  return text;
}

std::string Findings(const std::vector<RigFinding>& findings) {
  std::string text;
  for (const RigFinding& finding : findings)
    text += fmt::format("the rig is in doubt ({}): {}. What to do: {}\n", ToString(finding.code),
                        finding.reason, finding.hint);
  return text;
}

/// Reasons of sensors that are not ok, and directions that views leave open.
std::string Reasons(const std::vector<FrameResult>& sensors) {
  std::string text;
  // Reasons that several sensors have are given once.
  std::vector<char> said(sensors.size(), 0);
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    const FrameResult& sensor = sensors[i];
    if (sensor.status == SensorStatus::kOk || said[i]) continue;
    std::string names = sensor.name;
    for (std::size_t j = i + 1; j < sensors.size(); ++j) {
      const FrameResult& other = sensors[j];
      if (other.status != sensor.status || other.code != sensor.code ||
          other.reason != sensor.reason || other.hint != sensor.hint)
        continue;
      said[j] = 1;
      names += ", " + other.name;
    }
    const char* verb = sensor.status == SensorStatus::kFailed ? ""
                       : names == sensor.name                 ? "is "
                                                              : "are ";
    text += fmt::format("{} {}{} ({}): {}. What to do: {}\n", names, verb, ToString(sensor.status),
                        ToString(sensor.code), sensor.reason, sensor.hint);
  }
  text += BothPosesOf(sensors);
  for (const FrameResult& sensor : sensors) {
    if (!sensor.structure_from_sensor) continue;
    for (const std::string& direction : UnconstrainedDirections(sensor.covariance))
      text += fmt::format("{} is hardly constrained {}\n", sensor.name, direction);
  }
  return text;
}

double Rounded(double value, int digits) {
  const double scale = std::pow(10, digits);
  return std::round(value * scale) / scale + 0.0;
}

/// `where`: "in NAME: " if there are several captures.
std::string BoxesIn(const std::string& where, const std::vector<RefinedBox>& boxes,
                    const Structure& built) {
  std::string text;
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    const RefinedBox& box = boxes[b];
    if (!box.estimated) continue;
    text += fmt::format(
        "{}box {} stands {:+.1f} mm along x, {:+.1f} mm along z, turned by {:+.2f} deg "
        "(sigma {:.1f}, {:.1f} mm, {:.2f} deg)\n",
        where, built.boxes()[b].name, Rounded(1000 * box.x, 1), Rounded(1000 * box.z, 1),
        Rounded(box.yaw / kDegree, 2), 1000 * box.sigma_x, 1000 * box.sigma_z,
        box.sigma_yaw / kDegree);
  }
  return text;
}

std::string Boxes(const CalibrationResult& result) {
  std::string text;
  if (result.captures.empty()) text = BoxesIn("", result.boxes, result.built);
  for (const CaptureResult& capture : result.captures)
    text += BoxesIn(fmt::format("in {}: ", capture.name), capture.boxes, capture.built);
  if (result.size_estimated) {
    text += fmt::format("boxes are {:.2f} % of their nominal size (sigma {:.2f} %)\n",
                        100 * result.size_scale, 100 * result.sigma_size_scale);
  }
  return text;
}

/// The stack's place in each of several captures, and the sensors that show it.
std::string Placements(const CalibrationResult& result) {
  std::string text;
  for (std::size_t s = 0; s < result.captures.size(); ++s) {
    const CaptureResult& capture = result.captures[s];
    std::string placed, others;
    for (const FrameResult& sensor : capture.sensors) {
      if (sensor.structure_from_sensor) placed += (placed.empty() ? "" : ", ") + sensor.name;
      if (sensor.status == SensorStatus::kOk) continue;
      others +=
          fmt::format("; {} {} ({})", sensor.name, ToString(sensor.status), ToString(sensor.code));
    }
    const Pose& pose = capture.first_from_placement;
    std::string where = "the stack stands where poses are given";
    if (s > 0 && placed.empty()) where = "no sensor shows where the stack stood";
    if (s > 0 && !placed.empty()) {
      where = fmt::format(
          "the stack stood {:+.3f} m along x, {:+.3f} m along y, {:+.3f} m along z from there, "
          "turned by "
          "{:.2f} deg (sigma {:.1f} mm, {:.3f} deg)",
          pose.translation().x(), pose.translation().y(), pose.translation().z(),
          std::atan2(pose.linear()(0, 2), pose.linear()(0, 0)) / kDegree,
          1000 * SigmaTranslation(capture.covariance).maxCoeff(),
          SigmaRotationDeg(capture.covariance).maxCoeff());
    }
    text += fmt::format("in {}: {}; by {}{}\n", capture.name, where,
                        placed.empty() ? "none" : placed, others);
  }
  return text;
}

/// The origin of the lens, and whether the capture gives one.
std::string Words(LensSource source, bool distortion_given) {
  const std::string why = distortion_given ? "the lens differs from the one given: it"
                                           : "no lens distortion is given: it";
  switch (source) {
    case LensSource::kGiven:
      return "the lens is the one given";
    case LensSource::kKind:
      return why + " was taken as typical of the kind of sensor";
    case LensSource::kRecognised:
      return why + " was recognised by floor and walls as that of a known kind";
    case LensSource::kEstimated:
      return why + " was estimated from this capture";
  }
  return "";
}

/// A line for each source of lenses, with the sensors whose intrinsics are not as given.
std::string Lenses(const std::vector<FrameResult>& sensors) {
  struct Group {
    std::vector<std::string> names;
    double moved_px = 0, least_focal = 1, largest_focal = 1;
  };
  std::map<std::string, Group> groups;
  for (const FrameResult& sensor : sensors) {
    if (!sensor.structure_from_sensor || sensor.lens.source == LensSource::kGiven) continue;
    const double moved = LargestShift(sensor.intrinsics_given, sensor.intrinsics);
    if (!(moved > 0)) continue;
    const double focal = sensor.intrinsics.fx / sensor.intrinsics_given.fx;
    Group& group = groups[Words(sensor.lens.source, !sensor.intrinsics_given.distortion.empty())];
    const bool first = group.names.empty();
    group.names.push_back(sensor.name);
    group.moved_px = std::max(group.moved_px, moved);
    group.least_focal = first ? focal : std::min(group.least_focal, focal);
    group.largest_focal = first ? focal : std::max(group.largest_focal, focal);
  }
  std::string text;
  for (const auto& [words, group] : groups) {
    std::string focal = fmt::format("{:.4f}", group.least_focal);
    const std::string largest = fmt::format("{:.4f}", group.largest_focal);
    if (largest != focal) focal += " to " + largest;
    text += fmt::format(
        "{}: {}, with a focal length of {} times the given one; pixels lie up to {:.1f} px from "
        "where the given intrinsics have them, most at the image's edge\n",
        fmt::join(group.names, ", "), words, focal, group.moved_px);
  }
  return text;
}

std::string Solution(const SolveReport& solve) {
  if (solve.rounds == 0) return "";
  return fmt::format(
      "the joint solution has {}settled after {} round{}. The last one moved sensors by up to "
      "{:.1f} mm{}. The change of a lens moved pictures by up to {:.1f} px\n",
      solve.settled ? "" : "not ", solve.rounds, solve.rounds == 1 ? "" : "s", 1000 * solve.moved_m,
      solve.converged ? "" : " without converging", solve.moved_px);
}

std::string Seconds(const std::vector<std::pair<std::string, double>>& timings_s) {
  std::string text;
  for (const auto& [stage, seconds] : timings_s) {
    text += fmt::format("{} {} {:.2f}", text.empty() ? "seconds:" : ",", stage, seconds);
  }
  return text.empty() ? text : text + "\n";
}

}  // namespace

Table SensorsTable(const std::vector<FrameResult>& sensors) {
  Table table;
  table.columns = {"sensor",
                   "status",
                   {"code", ""},
                   {"reason", ""},
                   {"hint", ""},
                   "initial",
                   "sides",
                   {"rms_m", "rms mm", 1000, 1},
                   {"sigma_m", "sigma mm", 1000, 2},
                   {"sigma_deg", "sigma deg", 1, 3},
                   {"inliers", "inliers %", 100, 0},
                   {"error_m", "error mm", 1000, 2},
                   {"error_deg", "error deg", 1, 3}};
  for (const FrameResult& sensor : sensors) {
    std::vector<Table::Cell> row = {sensor.name, ToString(sensor.status)};
    row.resize(table.columns.size());
    if (sensor.status != SensorStatus::kOk) {
      row[2] = ToString(sensor.code);
      row[3] = sensor.reason;
      row[4] = sensor.hint;
    }
    if (sensor.structure_from_sensor) {
      row[5] = ToString(sensor.initial_source);
      row[6] = CellOf(sensor.sides.size());
      row[7] = sensor.rms_to_structure_m;
      row[8] = LargestSigmaPosition(*sensor.structure_from_sensor, sensor.covariance);
      row[9] = LargestSigmaRotationDeg(sensor.covariance);
      row[10] = sensor.inlier_share;
    }
    if (sensor.structure_from_sensor && sensor.error) {
      row[11] = sensor.error->translation_m;
      row[12] = sensor.error->rotation_deg;
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::string FormatNotes(const CalibrationResult& result) {
  return BothPosesOf(result.sensors) + Placements(result) + Lenses(result.sensors);
}

std::string FormatReport(const CalibrationResult& result) {
  std::string text = fmt::format("{} of {} sensors placed; verdict: {}", result.placed(),
                                 result.sensors.size(), ToString(result.verdict()));
  if (result.assembly && result.assembly->altered())
    text += fmt::format(": {}", result.assembly->arrangement.sentence);
  text += "\n" + Findings(result.findings) + Reasons(result.sensors) + SensorTable(result.sensors) +
          Placements(result) + Boxes(result) + Lenses(result.sensors) + Overlaps(result);
  if (result.metrics) {
    text += fmt::format(
        "d1 {:.1f} mm, d2 {:.1f} mm (the paper's: all points against the stack's surface)\n",
        1000 * result.metrics->d1, 1000 * result.metrics->d2);
  }
  if (result.placed() > 0) text += Solution(result.solve);
  return text + Seconds(result.timings_s);
}

namespace {

/// Names the least certain sensors, and advises a second capture.
/// Empty if there are several captures already, or fewer than two such sensors.
std::string AdviseSecondCapture(const CalibrationResult& result) {
  std::vector<std::pair<double, const FrameResult*>> known;
  for (const FrameResult& sensor : result.sensors) {
    if (!sensor.structure_from_sensor || !sensor.covariance.allFinite() ||
        !(sensor.covariance.determinant() > 0))
      continue;
    known.emplace_back(LargestSigmaPosition(*sensor.structure_from_sensor, sensor.covariance),
                       &sensor);
  }
  if (known.size() < 2 || !result.captures.empty()) return "";
  std::stable_sort(known.begin(), known.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  return fmt::format(
      "least certain: {} ({:.1f} mm) and {} ({:.1f} mm). To improve: move only the stack, capture "
      "again, and calibrate with both captures",
      known[0].second->name, 1000 * known[0].first, known[1].second->name, 1000 * known[1].first);
}

}  // namespace

std::vector<std::string> Advise(const CalibrationResult& result) {
  std::vector<std::string> advice;
  if (result.verdict() == SensorStatus::kOk) {
    advice.emplace_back(
        "the poses can be used: volalign convert writes them for other programs. To see later "
        "whether a sensor moved, take a new capture and run volalign check");
  } else if (result.placed() > 0 && !result.findings.empty()) {
    advice.emplace_back(
        "all poses are doubtful for the same reason: do what is said above, and calibrate again");
  } else if (result.placed() > 0) {
    advice.emplace_back(
        "use the poses of the sensors that are ok. For the others, do what is said above, and "
        "calibrate again");
  } else {
    advice.emplace_back("no pose can be used; do what is said above and calibrate again");
  }
  if (const std::string second = AdviseSecondCapture(result); !second.empty())
    advice.push_back(second);
  return advice;
}

}  // namespace volalign

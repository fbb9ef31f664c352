#include "infer/plan/plan_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/plot/rig_from_above.h"

namespace volalign {

namespace {

constexpr double kWellInView = 0.9;
constexpr std::size_t kFewSides = 4;

/// The weakest direction in the words of somebody behind the sensor.
std::string Direction(const PlannedSensor& sensor) {
  const Eigen::Vector3d view = -sensor.structure_from_sensor.translation().normalized();
  const Eigen::Vector3d up = Eigen::Vector3d::UnitY();
  const double along = std::abs(sensor.weakest.dot(view));
  const double height = std::abs(sensor.weakest.dot((up - up.dot(view) * view).normalized()));
  const double sideways = std::abs(sensor.weakest.dot(view.cross(up).normalized()));
  if (along > std::max(height, sideways)) return "to the stack";
  return height > sideways ? "up" : "sideways";
}

std::string Warnings(const PlannedSensor& sensor) {
  std::string text;
  const auto add = [&](const std::string& sentence) {
    text += fmt::format("{}: {}\n", sensor.name, sentence);
  };
  if (sensor.sides.empty()) {
    add("it sees no side of the stack: turn it towards the stack, or move it closer");
    return text;
  }
  if (!sensor.sides_fix_pose) {
    add("the sides that it sees do not determine its pose; let it see sides of three orientations");
  } else if (sensor.sides.size() < kFewSides) {
    add(fmt::format("it sees {} sides only; turn the stack, or raise the sensor above its top",
                    sensor.sides.size()));
  }
  if (sensor.in_view < kWellInView) {
    add(fmt::format("only {:.0f} % of what it could see of the stack is in its picture",
                    100 * sensor.in_view));
  }
  if (sensor.status != SensorStatus::kOk) {
    add(fmt::format("expected to be {} ({}): {}; {}", ToString(sensor.status),
                    ToString(sensor.finding.code), sensor.finding.reason, sensor.finding.hint));
  }
  return text;
}

/// A line on how far the sensors' clouds will be from each other, because a capture lab fuses
/// clouds.
std::string PairsLine(const RigPlan& plan) {
  std::size_t overlapping = 0;
  double apart = 0, sigma = 0;
  for (const PairResult& pair : plan.pairs) {
    sigma = std::max(sigma, pair.sigma_m);
    if (!pair.overlaps()) continue;
    ++overlapping;
    apart = std::max(apart, pair.predicted_rms_m);
  }
  if (plan.pairs.empty()) return "";
  std::string text = fmt::format(
      "of {} pair{} of sensors {} overlap{}", plan.pairs.size(), plan.pairs.size() == 1 ? "" : "s",
      overlapping,
      overlapping > 0
          ? fmt::format(": expect their points to be at most {:.1f} mm RMS apart", 1000 * apart)
          : "");
  return text + fmt::format(
                    ". The uncertainty of their places relative to each other will be {:.1f} mm "
                    "(one standard deviation) or less\n",
                    1000 * sigma);
}

}  // namespace

Table PlanTable(const RigPlan& plan) {
  Table table;
  table.columns = {"sensor",
                   {"distance_m", "dist m", 1, 2},
                   "sides",
                   {"pixels", "px"},
                   {"in_view", "in view %", 100, 0},
                   "placed",
                   {"trials", "of"},
                   {"expected_m", "mm", 1000, 1},
                   {"expected_deg", "deg", 1, 2},
                   {"weakest_direction", "known least"},
                   {"weakest_m", "mm", 1000, 1},
                   {"status", ""},
                   {"code", ""},
                   {"reason", ""},
                   {"hint", ""}};
  for (const PlannedSensor& sensor : plan.sensors) {
    int pixels = 0;
    for (const auto& side : sensor.sides) pixels += side.second;
    std::vector<Table::Cell> row = {
        sensor.name,    sensor.distance_m,     CellOf(sensor.sides.size()), CellOf(pixels),
        sensor.in_view, CellOf(sensor.placed), CellOf(plan.trials)};
    row.resize(table.columns.size());
    if (sensor.placed > 0) {
      row[7] = sensor.expected_m;
      row[8] = sensor.expected_deg;
      row[9] = Direction(sensor);
      row[10] = sensor.weakest_m;
    }
    row[11] = ToString(sensor.status);
    if (sensor.status != SensorStatus::kOk) {
      row[12] = ToString(sensor.finding.code);
      row[13] = sensor.finding.reason;
      row[14] = sensor.finding.hint;
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::string FormatPlan(const RigPlan& plan) {
  std::size_t width = 6;
  for (const PlannedSensor& sensor : plan.sensors) width = std::max(width, sensor.name.size());
  std::string text = FormatTable(PlanTable(plan), TableFormat::kText);
  text +=
      "dist: distance from the stack's origin\nsides: number of sides with enough pixels\npx: "
      "pixels on them\nin view: share of the visible surface that the picture shows\nplaced: share "
      "of the trials that found a pose\nmm, deg: expected root mean square error\nknown least: "
      "direction of its largest part\n";
  for (const PlannedSensor& sensor : plan.sensors) {
    std::string sides;
    for (const auto& [side, pixels] : sensor.sides)
      sides += fmt::format("{}{} {}", sides.empty() ? "" : ", ", side, pixels);
    text += fmt::format("{:<{}}  sees {}\n", sensor.name, width, sides.empty() ? "nothing" : sides);
  }
  for (const PlannedSensor& sensor : plan.sensors) text += Warnings(sensor);
  return text + PairsLine(plan);
}

namespace {

const char* Colour(SensorStatus status) {
  if (status == SensorStatus::kFailed) return kVermilion;
  return status == SensorStatus::kWeak ? kOrange : kBlue;
}

}  // namespace

std::string PlanPicture(const RigPlan& plan) {
  std::vector<SensorFromAbove> sensors;
  for (const PlannedSensor& sensor : plan.sensors) {
    sensors.push_back(
        {sensor.name,
         sensor.placed > 0
             ? fmt::format("{:.1f} mm, {:.2f}°", 1000 * sensor.expected_m, sensor.expected_deg)
             : "not placed",
         "", Colour(sensor.status), sensor.intrinsics, sensor.structure_from_sensor,
         PositionCovariance(sensor.structure_from_sensor, sensor.covariance)});
  }
  return RigFromAbove(plan.structure, sensors,
                      {{{kBlue, "ok"}, {kOrange, "weak"}, {kVermilion, "failed"}},
                       "from above, structure frame; by each name its expected error"});
}

}  // namespace volalign

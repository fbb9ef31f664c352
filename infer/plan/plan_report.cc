#include "infer/plan/plan_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace volalign {

namespace {

constexpr double kWellInView = 0.9;
constexpr std::size_t kFewSides = 4;

/// The direction of `axis` as somebody behind the sensor would call it.
std::string Direction(const PlannedSensor& sensor) {
  const Eigen::Vector3d view = -sensor.structure_from_sensor.translation().normalized();
  const Eigen::Vector3d up = Eigen::Vector3d::UnitY();
  const double along = std::abs(sensor.weakest.dot(view));
  const double height = std::abs(sensor.weakest.dot((up - up.dot(view) * view).normalized()));
  const double sideways = std::abs(sensor.weakest.dot(view.cross(up).normalized()));
  if (along > std::max(height, sideways)) return "to the stack";
  return height > sideways ? "up" : "sideways";
}

std::string Row(const PlannedSensor& sensor, int trials, std::size_t width) {
  int pixels = 0;
  for (const auto& side : sensor.sides) pixels += side.second;
  std::string row = fmt::format("{:<{}}  {:>6.2f}  {:>5}  {:>6}  {:>5.0f} %  {:>6}", sensor.name,
                                width, sensor.distance_m, sensor.sides.size(), pixels,
                                100 * sensor.in_view, fmt::format("{}/{}", sensor.placed, trials));
  if (sensor.placed > 0) {
    row += fmt::format("  {:>6.1f}  {:>6.2f}  {} {:.1f} mm", 1000 * sensor.expected_m,
                       sensor.expected_deg, Direction(sensor), 1000 * sensor.weakest_m);
  }
  return row + '\n';
}

std::string Warnings(const PlannedSensor& sensor) {
  std::string text;
  const auto add = [&](const std::string& sentence) {
    text += fmt::format("{}: {}\n", sensor.name, sentence);
  };
  if (sensor.sides.empty()) {
    add("it sees no side of the stack; look at it, or come nearer");
    return text;
  }
  if (!sensor.sides_fix_pose) {
    add("the sides that it sees do not fix its pose; it needs sides of three orientations");
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

}  // namespace

std::string FormatPlan(const RigPlan& plan) {
  std::size_t width = 6;
  for (const PlannedSensor& sensor : plan.sensors) width = std::max(width, sensor.name.size());
  std::string text =
      fmt::format("{:<{}}  {:>6}  {:>5}  {:>6}  {:>7}  {:>6}  {:>6}  {:>6}  {}\n", "sensor", width,
                  "dist m", "sides", "px", "in view", "placed", "mm", "deg", "known least");
  for (const PlannedSensor& sensor : plan.sensors) text += Row(sensor, plan.trials, width);
  text +=
      "dist: to the stack's origin; sides: with enough pixels; px: on them; in view: share, within "
      "the picture, of the surface that could be seen from there; placed: of the trials; mm, deg: "
      "expected (root mean square) error of position and orientation; known least: direction of "
      "the largest part of it\n";
  for (const PlannedSensor& sensor : plan.sensors) {
    std::string sides;
    for (const auto& [side, pixels] : sensor.sides)
      sides += fmt::format("{}{} {}", sides.empty() ? "" : ", ", side, pixels);
    text += fmt::format("{:<{}}  sees {}\n", sensor.name, width, sides.empty() ? "nothing" : sides);
  }
  for (const PlannedSensor& sensor : plan.sensors) text += Warnings(sensor);
  return text;
}

}  // namespace volalign

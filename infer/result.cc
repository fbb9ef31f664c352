#include "infer/result.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "core/json_archive.h"
#include "infer/describe_result.h"

namespace volalign {

void DemoteIfNotFinite(SensorOutcome* sensor) {
  if (!sensor->structure_from_sensor) return;
  if (!sensor->structure_from_sensor->matrix().allFinite()) {
    sensor->structure_from_sensor.reset();
    sensor->status = SensorStatus::kFailed;
    sensor->code = SensorCode::kNotFinite;
    sensor->reason = "its pose came out as no finite numbers";
    sensor->hint = "let it see more sides, or leave it out of the capture";
    return;
  }
  JsonWriter writer(sensor->name);
  Describe(writer, *sensor);
  if (writer.left_out().empty()) return;
  const std::string problem =
      fmt::format("not finite, and left out: {}", fmt::join(writer.left_out(), ", "));
  // That a pose is uncertain goes without saying where its covariance is not known.
  if (sensor->code == SensorCode::kNone || sensor->code == SensorCode::kUncertain) {
    sensor->code = SensorCode::kNotFinite;
    sensor->reason = problem;
    sensor->hint = "its pose stands, but let it see more sides, or more of what its neighbours see";
  } else if (sensor->code != SensorCode::kNotFinite) {
    sensor->reason += "; " + problem;
  }
  sensor->status = SensorStatus::kWeak;
}

SensorStatus CalibrationResult::verdict() const {
  SensorStatus worst = SensorStatus::kOk;
  for (const SensorResult& sensor : sensors) worst = std::max(worst, sensor.status);
  return worst;
}

int CalibrationResult::placed() const {
  return static_cast<int>(std::count_if(
      sensors.begin(), sensors.end(),
      [](const SensorResult& sensor) { return sensor.structure_from_sensor.has_value(); }));
}

}  // namespace volalign

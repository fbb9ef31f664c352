#include "infer/result.h"

#include <algorithm>

namespace volalign {

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

#include "infer/plan/plan_picture.h"

#include <fmt/format.h>

#include <vector>

#include "core/plot/rig_from_above.h"

namespace volalign {

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

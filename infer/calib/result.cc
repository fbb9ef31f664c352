#include "infer/calib/result.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "infer/calib/describe_result.h"

namespace volalign {

namespace {

/// An archive that lists the quantities of a description that are not finite.
class NotFinite {
 public:
  static constexpr bool kReading = false;
  const std::vector<std::string>& keys() const { return keys_; }

  template <class T, class... Absent>
  void IfFinite(const char* key, const T& value, const Absent&... /*absent*/) {
    if (!IsFinite(value)) keys_.emplace_back(key);
  }
  // Values that are always written are finite, or no numbers.
  template <class T>
  void operator()(const char* /*key*/, const T& /*value*/) {}
  template <class T>
  void Optional(const char* /*key*/, const T& /*value*/) {}
  template <class T>
  void OptionalSinceVersion(const char* /*key*/, const T& /*value*/) {}

 private:
  static bool IsFinite(double value) { return std::isfinite(value); }
  static bool IsFinite(const Pose& pose) { return pose.matrix().allFinite(); }
  template <class T>
  static bool IsFinite(const Eigen::MatrixBase<T>& matrix) {
    return matrix.allFinite();
  }

  std::vector<std::string> keys_;
};

}  // namespace

void DemoteIfNotFinite(SensorOutcome* sensor) {
  if (!sensor->structure_from_sensor) return;
  if (!sensor->structure_from_sensor->matrix().allFinite()) {
    sensor->structure_from_sensor.reset();
    sensor->status = SensorStatus::kFailed;
    sensor->code = SensorCode::kNotFinite;
    sensor->reason = "its pose has numbers that are not finite";
    sensor->hint = "let it see more sides, or leave it out of the capture";
    return;
  }
  NotFinite not_finite;
  Describe(not_finite, *sensor);
  if (not_finite.keys().empty()) return;
  const std::string problem =
      fmt::format("not finite, and left out: {}", fmt::join(not_finite.keys(), ", "));
  // A covariance that is not known makes a pose uncertain in any case.
  if (sensor->code == SensorCode::kNone || sensor->code == SensorCode::kUncertain) {
    sensor->code = SensorCode::kNotFinite;
    sensor->reason = problem;
    sensor->hint =
        "let it see more sides, or more of what its neighbours see. The pose itself can be used";
  } else if (sensor->code != SensorCode::kNotFinite) {
    sensor->reason += "; " + problem;
  }
  sensor->status = SensorStatus::kWeak;
}

SensorStatus CalibrationResult::verdict() const {
  SensorStatus worst = findings.empty() ? SensorStatus::kOk : SensorStatus::kWeak;
  for (const FrameResult& sensor : sensors) worst = std::max(worst, sensor.status);
  return worst;
}

int StackResult::placed() const {
  return static_cast<int>(std::count_if(
      sensors.begin(), sensors.end(),
      [](const FrameResult& sensor) { return sensor.structure_from_sensor.has_value(); }));
}

}  // namespace volalign

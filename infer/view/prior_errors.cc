#include "infer/view/prior_errors.h"

#include "core/geometry/sensor_kind.h"

namespace volalign {

DepthErrorModel PriorErrorsOf(const std::string& sensor) {
  DepthErrorModel errors = ErrorsOf(sensor);
  const DepthErrorModel unknown = ErrorsOf("");
  errors.smooth_m = unknown.smooth_m;
  errors.smooth_power = unknown.smooth_power;
  return errors;
}

}  // namespace volalign

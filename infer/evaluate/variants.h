#pragma once

#include <string>
#include <vector>

#include "core/config/config.h"
#include "infer/calib/calibrate.h"

namespace volalign {

/// Calibration options to compare, e.g. {"paper", ...} and {"network", ...}.
struct EvaluationVariant {
  std::string name;
  CalibrateOptions options;
};

/// The options that `compare` ("initial.method=paper,network") sets over `source`, each named after
/// its value, in order. Without it one variant, "volalign", with `source` alone. Throws
/// ConfigError.
std::vector<EvaluationVariant> ReadVariants(const ConfigSource& source, const std::string& compare);

}  // namespace volalign

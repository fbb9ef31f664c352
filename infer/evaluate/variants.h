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

/// The options that `compare` ("initial.method=paper,network") asks for over `source`, each named
/// after its value, in order; without it one, of `source` alone, named "volalign". Throws
/// ConfigError.
std::vector<EvaluationVariant> ReadVariants(const ConfigSource& source, const std::string& compare);

}  // namespace volalign

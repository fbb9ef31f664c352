#pragma once

#include <cstdint>

#include "train/train_config.h"
#include "train/validation.h"

namespace volalign {

/// NaN where no sample has a pose and the metric is one of poses.
double ValueOf(BestMetric metric, const ValidationResult& result);
bool LargerIsBetter(BestMetric metric);

/// The best of the validations so far.
struct BestValidation {
  std::int64_t samples = -1;  ///< after which it was; -1: there is none
  double value = 0;
  int since = 0;  ///< validations that came after it

  /// Takes a validation into account; true: it is the best. The earlier of equal ones stays.
  bool Note(BestMetric metric, const ValidationResult& result, std::int64_t at_samples);
};

}  // namespace volalign

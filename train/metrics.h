#pragma once

#include <cstdint>

#include "train/step.h"
#include "train/validation.h"

namespace volalign {

/// A row of the training's log: means over the steps since the row before.
struct TrainRow {
  std::int64_t step = 0, samples = 0;  ///< so far
  double lr = 0;                       ///< of the last step
  double samples_per_s = 0;            ///< over the steps alone, validation and saving left out
  StepReport mean;                     ///< but `degenerate`, which is a sum
};

struct ValidationRow {
  std::int64_t step = 0, samples = 0;
  ValidationResult result;
};

/// Sums over the steps since the last TrainRow.
struct StepMeans {
  std::int64_t steps = 0, samples = 0;
  StepReport sum;

  void Add(const StepReport& step, std::int64_t step_samples);
  /// The means; begins anew.
  TrainRow Take(std::int64_t step, std::int64_t samples_so_far, double lr);
};

}  // namespace volalign

#pragma once

#include <cstdint>

#include "train/train_config.h"

namespace volalign {

/// Learning rate of the step that starts after `samples` of `total` samples.
double LearningRate(const OptimConfig& config, std::int64_t samples, std::int64_t total);

}  // namespace volalign

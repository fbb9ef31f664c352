#pragma once

#include <string>

#include "core/checkpoint.h"
#include "train/train_config.h"
#include "train/validation.h"

namespace volalign {

/// Scores a network on `samples` rendered samples (rounded up to whole batches) of config.data,
/// config.run.batch_size and the seed config.run.validation_seed, in float32 on config.run.device;
/// the losses are config.loss's. Throws DataError when the model has other labels than the
/// configuration's structure.
ValidationResult ValidateCheckpoint(LoadedModel& model, const TrainConfig& config, int samples);

/// Markdown table: all samples, each sensor, and each band of horizontal distance 150-225, 225-275
/// and 275-350 cm (design section 7) that has samples.
std::string ValidationTable(const ValidationResult& result);

}  // namespace volalign

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/json/table.h"
#include "core/nn/checkpoint.h"
#include "train/train_config.h"
#include "train/validation.h"

namespace volalign {

/// Scores a network on rendered or recorded samples, in float32 on config.run.device. There are
/// `samples` rendered samples (rounded up to whole batches) of config.data, config.run.batch_size
/// and the seed config.run.validation_seed. If config.data.real.validation has recorded frames,
/// each of these is scored once instead. The losses are config.loss's. The stack is the model's
/// own, unless `structure` is given. Throws DataError if that has other labels than the model. The
/// intrinsics are the model's own if it has those of each of config.data.sensors.
/// `count` receives the progress in samples.
ValidationResult ValidateCheckpoint(LoadedModel& model, const TrainConfig& config, int samples,
                                    const CountDone& count = nullptr,
                                    const Structure* structure = nullptr);

/// A checkpoint and its scores.
struct ValidatedModel {
  std::string file;
  std::int64_t training_samples = 0;
  ValidationResult result;
};

/// A JSON list of objects: model, training_samples, the means of ValidationResult by their names,
/// and `by_sensor` and `by_rho_cm`. These have the same means for each sensor and each band of
/// ValidationTable.
std::string ValidationJson(const std::vector<ValidatedModel>& models);

/// Rows per checkpoint: all samples, each sensor, and each band of horizontal distance 150-225,
/// 225-275 and 275-350 cm that has samples. The bands are the differences of the paper's three
/// ranges.
Table ValidationTable(const std::vector<ValidatedModel>& models);

}  // namespace volalign

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/json/table.h"
#include "core/nn/checkpoint.h"
#include "train/train_config.h"
#include "train/validation.h"

namespace volalign {

/// Scores a network on `samples` rendered samples (rounded up to whole batches) of config.data,
/// config.run.batch_size and the seed config.run.validation_seed, or on the recorded frames of
/// config.data.real.validation, each once, in float32 on config.run.device; the losses are
/// config.loss's. The stack is the model's own, or `structure` in its place. Throws DataError when
/// that has other labels than the model. `count` is told of samples.
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
/// and `by_sensor` and `by_rho_cm`, the same for each sensor and each band of ValidationTable.
std::string ValidationJson(const std::vector<ValidatedModel>& models);

/// For each checkpoint a row for all samples, for each sensor, and for each band of horizontal
/// distance 150-225, 225-275 and 275-350 cm that has samples: what each of the paper's three ranges
/// adds to the one before.
Table ValidationTable(const std::vector<ValidatedModel>& models);

}  // namespace volalign

#pragma once

#include <string>

#include "train/train_config.h"

namespace volalign {

/// Throws ConfigError if `config` differs from `saved_yaml`, the configuration of the state `path`,
/// in a key that changes a sample or a step. Other keys may differ if a run is resumed.
void RequireSameRun(const std::string& saved_yaml, const TrainConfig& config,
                    const std::string& path);

/// Are the results of validations under both configurations comparable?
bool SameValidation(const std::string& saved_yaml, const TrainConfig& config);

}  // namespace volalign

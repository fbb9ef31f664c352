#pragma once

#include <string>

#include "train/train_config.h"

namespace volalign {

/// Throws ConfigError when `config` differs from `saved_yaml`, with which the state `path` was
/// saved, in a key that changes a sample or a step; other keys may differ when a run is resumed.
void RequireSameRun(const std::string& saved_yaml, const TrainConfig& config,
                    const std::string& path);

/// Whether validations under both configurations have comparable results.
bool SameValidation(const std::string& saved_yaml, const TrainConfig& config);

}  // namespace volalign

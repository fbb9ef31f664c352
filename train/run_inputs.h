#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "train/train_config.h"

namespace volalign {

/// A run folder keeps the files of its samples beside the recipe: `structure.yaml` and
/// `intrinsics.yaml`.

/// Writes the files that `dir` lacks: data.structure, or a description of `structure` if that file
/// differs from it, and data.intrinsics. Throws IoError.
void KeepInputs(const std::filesystem::path& dir, const TrainConfig& config,
                const Structure& structure);

/// Throws ConfigError, with the key and both files, if the run in `dir` began with another
/// `structure` or other intrinsics of the recipe's sensors. A run of an earlier version kept no
/// file: its model.safetensors has the structure.
void RequireSameInputs(const std::filesystem::path& dir, const TrainConfig& config,
                       const Structure& structure);

/// If data.structure or data.intrinsics is missing and `dir` is a run folder, the kept file
/// replaces it. Returns a sentence for each.
std::vector<std::string> UseKeptInputs(const std::filesystem::path& dir,
                                       TrainingDataConfig* config);

/// The kept intrinsics of `dir`, or "".
std::string KeptIntrinsics(const std::filesystem::path& dir);

}  // namespace volalign

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "train/train_config.h"

namespace volalign {

/// A run folder keeps the files that its samples come from beside the recipe: `structure.yaml`
/// and `intrinsics.yaml`.

/// Writes what `dir` has not yet: the file data.structure, or a description of `structure` where
/// that file is another, and the file data.intrinsics. Throws IoError.
void KeepInputs(const std::filesystem::path& dir, const TrainConfig& config,
                const Structure& structure);

/// Throws ConfigError, which names the key and both files, where `structure` or the intrinsics of
/// the recipe's sensors are others than those that the run in `dir` began with. Of a run of an
/// earlier version, which kept no file, its model.safetensors has the structure.
void RequireSameInputs(const std::filesystem::path& dir, const TrainConfig& config,
                       const Structure& structure);

/// Where data.structure or data.intrinsics is not found, and `dir` is a run folder, puts the file
/// that it keeps in its place. Returns a sentence for each.
std::vector<std::string> UseKeptInputs(const std::filesystem::path& dir,
                                       TrainingDataConfig* config);

/// The intrinsics that `dir` keeps, or "".
std::string KeptIntrinsics(const std::filesystem::path& dir);

}  // namespace volalign

#include "train/same_run.h"

#include <fmt/format.h>

#include <set>
#include <vector>

#include "core/base/error.h"
#include "core/config/config.h"

namespace volalign {
namespace {

/// Keys that may differ if a run is resumed. They change no sample and no step, with two
/// exceptions. run.threads and run.device change the rounding of a step's sums. So does
/// data.renderer, which also changes few pixels at edges. RequireSameInputs compares the contents
/// of data.structure and data.intrinsics.
const std::set<std::string>& FreeKeys() {
  static const std::set<std::string> keys = {"data.real.validation", "data.renderer",
                                             "data.structure",       "data.intrinsics",
                                             "run.samples",          "run.validation_samples",
                                             "run.validate_every",   "run.checkpoint_every",
                                             "run.tensorboard",      "run.log_every",
                                             "run.threads",          "run.loader_threads",
                                             "run.device",           "run.lost_after_s",
                                             "run.dataset",          "run.validation_dataset"};
  return keys;
}

}  // namespace

void RequireSameRun(const std::string& saved_yaml, const TrainConfig& config,
                    const std::string& path) {
  // A key that is newer than the state had the effect of its default.
  const ConfigSource before =
      ConfigSource::FromString(WriteConfig(ReadSavedConfig(saved_yaml, path)), path);
  const ConfigSource now = ConfigSource::FromString(WriteConfig(config), "the given configuration");
  for (const auto& [key, leaf] : now.leaves()) {
    const std::vector<std::string>& values = before.leaves().at(key).values;
    if (values == leaf.values) continue;
    if (key == "run.samples" && config.optim.DependsOnLength()) {
      throw ConfigError(fmt::format(
          "run.samples = {} differs from {} in {}: with this optim.schedule the learning rate "
          "depends on "
          "it, and would jump: resume with the run's own, or start a new run from its weights with "
          "run.init",
          fmt::join(leaf.values, ", "), fmt::join(values, ", "), path));
    }
    if (FreeKeys().count(key) > 0) continue;
    throw ConfigError(fmt::format(
        "{} = {} differs from {} in {}: resume with the run's own config.yaml, or start a new run",
        key, fmt::join(leaf.values, ", "), fmt::join(values, ", "), path));
  }
}

bool SameValidation(const std::string& saved_yaml, const TrainConfig& config) {
  const TrainConfig before = ReadSavedConfig(saved_yaml, "the saved configuration");
  return before.run.validation_samples == config.run.validation_samples &&
         before.run.validation_dataset == config.run.validation_dataset &&
         before.data.real.validation == config.data.real.validation;
}

}  // namespace volalign

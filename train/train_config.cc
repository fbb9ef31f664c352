#include "train/train_config.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/base/error.h"

namespace volalign {

void TrainConfig::Validate() const {
  if (run.seed == run.validation_seed) {
    throw ConfigError(
        fmt::format("run.validation_seed = {} violates run.validation_seed != run.seed: validation "
                    "would see the "
                    "training samples",
                    run.validation_seed));
  }
  if (loss.terms.size() != loss.term_weights.size()) {
    throw ConfigError(fmt::format(
        "loss.term_weights has {} numbers and loss.terms {} names: give one weight for each",
        loss.term_weights.size(), loss.terms.size()));
  }
  for (const std::string& name : loss.terms) {
    if (std::count(loss.terms.begin(), loss.terms.end(), name) > 1)
      throw ConfigError(fmt::format("loss.terms has '{}' twice: give it once", name));
  }
  if (run.micro_batch > run.batch_size) {
    throw ConfigError(
        fmt::format("run.micro_batch = {} violates run.micro_batch <= run.batch_size = {}",
                    run.micro_batch, run.batch_size));
  }
}

TrainConfig ReadTrainConfig(const ConfigSource& source) {
  TrainConfig config = ReadConfig<TrainConfig>(source);
  config.Validate();
  return config;
}

TrainConfig ReadSavedConfig(const std::string& yaml, const std::string& name) {
  return ReadConfig<TrainConfig>(ConfigSource::FromString(yaml, name));
}

}  // namespace volalign

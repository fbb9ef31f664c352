#include "train/train_config.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/base/error.h"
#include "core/nn/network.h"

namespace volalign {

StructureNetOptions ModelConfig::Options(int num_classes) const {
  StructureNetOptions options;
  options.kind = kind;
  options.base_channels = base_channels;
  options.num_classes = num_classes;
  options.attention = attention;
  options.normalization = normalization;
  options.input = input;
  options.residual_blocks = residual_blocks;
  options.background_bias = background_bias;
  return options;
}

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

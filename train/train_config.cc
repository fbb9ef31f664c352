#include "train/train_config.h"

#include <fmt/format.h>

#include "core/error.h"

namespace volalign {

StructureNetOptions ModelConfig::Options(int num_classes) const {
  StructureNetOptions options;
  options.base_channels = base_channels;
  options.num_classes = num_classes;
  options.attention = attention;
  options.normalization = ParseNormalization(normalization);
  options.input = ParseInputEncoding(input);
  options.residual_blocks = residual_blocks;
  options.background_bias = background_bias;
  return options;
}

KeypointKind ParseKeypointKind(const std::string& word) {
  if (word == "centre") return KeypointKind::kCentre;
  if (word == "exposed") return KeypointKind::kExposed;
  throw ConfigError(fmt::format("loss.keypoints = '{}' is unknown: use centre or exposed", word));
}

void TrainConfig::Validate() const {
  if (run.seed == run.validation_seed) {
    throw ConfigError(
        fmt::format("run.validation_seed = {} violates run.validation_seed != run.seed: validation "
                    "would see the "
                    "training samples",
                    run.validation_seed));
  }
  if (optim.schedule == "one_cycle" && optim.warmup_samples >= run.samples) {
    throw ConfigError(
        fmt::format("optim.warmup_samples = {} violates optim.warmup_samples < run.samples = {}",
                    optim.warmup_samples, run.samples));
  }
  if (optim.optimizer == "adam" && optim.weight_decay > 0) {
    throw ConfigError(
        fmt::format("optim.weight_decay = {} needs optim.optimizer = adamw", optim.weight_decay));
  }
}

TrainConfig ReadTrainConfig(const ConfigSource& source) {
  TrainConfig config = ReadConfig<TrainConfig>(source);
  config.Validate();
  return config;
}

}  // namespace volalign

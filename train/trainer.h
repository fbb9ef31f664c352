#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "train/distributed/world.h"
#include "train/train_config.h"
#include "train/training_data.h"
#include "train/validation.h"

namespace volalign {

struct TrainOptions {
  std::filesystem::path run_dir;
  /// Continue the run in run_dir from its newest state: same samples, weights, optimiser and
  /// learning rate; from its beginning where it was killed before the first state. Throws
  /// ConfigError where run.samples differs and the learning rate depends on it.
  bool resume = false;
  /// Stop there as if interrupted (a cluster's time limit); 0: at run.samples.
  std::int64_t stop_at_samples = 0;
  bool quiet = false;  ///< no progress on stderr
  World world;         ///< this process among those that train together
  /// Called in rank 0 once run_dir is there and its run may begin or go on, before anything else is
  /// written into it.
  std::function<void()> begun;
};

struct TrainResult {
  std::int64_t samples = 0;          ///< drawn in all, resumed ones included
  bool finished = false;             ///< false: interrupted, can be resumed
  int signal = 0;                    ///< that interrupted it; 0: none did
  ValidationResult validation;       ///< the last one, where this call made one
  std::filesystem::path checkpoint;  ///< run_dir/model.safetensors
};

/// Trains a network on samples rendered as it goes, or on run.dataset, and
/// fills the run folder:
///   config.yaml    the resolved configuration
///   structure.yaml, intrinsics.yaml: what the samples come from beside it
///   metrics.jsonl  a row every run.log_every samples (means since the row before) and one a
///                  validation
///   states/        all that --resume needs, after so many samples as the name says (format
///                  volalign.training/3); the two newest ones
///   model.safetensors       the deployable checkpoint (core/nn/checkpoint.h) of the averaged
///   weights best.safetensors        that of the best validation tensorboard/   event files of the
///   same metrics, with pictures of labels
/// SIGINT and SIGTERM stop it after the current micro-batch or batch of a validation, with the
/// state saved; of several processes, after the current step. A run that was stopped or killed at
/// any moment and is resumed ends with the weights of one that was not, bit for bit on a CPU with
/// the same number of threads. A step whose loss or gradient is not finite is skipped and counted.
/// Throws ConfigError (a resumed run's configuration, structure or intrinsics differ so that it
/// would be another run), Error (a
/// run is there already; no step between two rows was finite), IoError, DataError.
TrainResult Train(const TrainConfig& config, const TrainOptions& options);

/// The same on other samples than the configuration's.
TrainResult TrainOn(const TrainingData& data, const TrainConfig& config,
                    const TrainOptions& options);

}  // namespace volalign

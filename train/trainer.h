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
  /// Continue the run in run_dir from its newest state, with the same samples, weights, optimiser
  /// and learning rate. If it was killed before the first state, it begins again. Throws
  /// ConfigError if run.samples differs and the learning rate depends on it.
  bool resume = false;
  /// Stop there as if interrupted (a cluster's time limit); 0: at run.samples.
  std::int64_t stop_at_samples = 0;
  bool quiet = false;  ///< no progress on stderr
  World world;         ///< this process among those that train together
  /// Called in rank 0 when run_dir exists and its run may begin or continue, before anything else
  /// is written to it.
  std::function<void()> begun;
};

struct TrainResult {
  std::int64_t samples = 0;          ///< drawn in all, including those before a resumption
  bool finished = false;             ///< false: interrupted, can be resumed
  int signal = 0;                    ///< the signal that interrupted it; 0: none
  ValidationResult validation;       ///< the last one, if this call made one
  std::filesystem::path checkpoint;  ///< run_dir/model.safetensors
};

/// Trains a network on samples rendered as it goes, or on run.dataset, and fills the run folder.
/// `config.yaml` is the resolved configuration. `structure.yaml` and `intrinsics.yaml` are the
/// other sources of the samples. `metrics.jsonl` has a row every run.log_every samples (means since
/// the previous row) and one per validation. `states/` has all that --resume needs (format
/// volalign.training/3): the two newest states, named by their numbers of samples.
/// `model.safetensors` is the deployable checkpoint (core/nn/checkpoint.h) of the averaged weights,
/// `best.safetensors` that of the best validation. `tensorboard/` has event files of the same
/// metrics, with pictures of labels.
///
/// SIGINT and SIGTERM stop it with the state saved, after the current micro-batch or batch of a
/// validation, or after the current step of several processes. A run may be stopped or killed at
/// any moment. Resumed, it ends with the same weights, bit for bit on a CPU with the same number of
/// threads. A step whose loss or gradient is not finite is skipped and counted. Throws ConfigError
/// if a resumed run's configuration, structure or intrinsics would make it another run. Throws
/// Error if a run exists already, or if no step between two rows was finite. Throws IoError,
/// DataError.
TrainResult Train(const TrainConfig& config, const TrainOptions& options);

/// The same on other samples than the configuration's.
TrainResult TrainOn(const TrainingData& data, const TrainConfig& config,
                    const TrainOptions& options);

}  // namespace volalign

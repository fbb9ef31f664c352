#pragma once

#include <cstdint>
#include <filesystem>

#include "train/train_config.h"
#include "train/training_data.h"
#include "train/validation.h"

namespace volalign {

struct TrainOptions {
  std::filesystem::path run_dir;
  /// Continue run_dir/last.state: same samples, weights, optimiser and learning rate. Throws
  /// ConfigError where run.samples differs and the schedule is one_cycle, which depends on it.
  bool resume = false;
  /// Stop there as if interrupted (a cluster's time limit); 0: at run.samples.
  std::int64_t stop_at_samples = 0;
  bool quiet = false;  ///< no progress on stderr
};

struct TrainResult {
  std::int64_t samples = 0;  ///< drawn in all, resumed ones included
  bool finished = false;     ///< false: interrupted, can be resumed
  double loss = 0;           ///< of the last step
  ValidationResult validation;
  std::filesystem::path checkpoint;  ///< run_dir/model.pt
};

/// Trains a network on samples rendered as it goes, or on run.dataset, and
/// fills the run folder:
///   config.yaml    the resolved configuration
///   metrics.jsonl  a row every run.log_every samples (means since the row before) and one a
///                  validation
///   last.state     all that --resume needs (format volalign.training/1)
///   model.pt       the deployable checkpoint (core/checkpoint.h) of the averaged weights
/// SIGINT and SIGTERM stop it after the current step, with the state saved.
/// Throws ConfigError (a resumed run's configuration differs in a key that changes it), Error (a
/// run is there already; loss or gradient is not finite), IoError, DataError.
TrainResult Train(const TrainConfig& config, const TrainOptions& options);

/// The same on other samples than the configuration's.
TrainResult TrainOn(const TrainingData& data, const TrainConfig& config,
                    const TrainOptions& options);

}  // namespace volalign

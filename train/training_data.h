#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "core/base/batch_slice.h"
#include "core/geometry/structure.h"
#include "train/batch.h"
#include "train/train_config.h"

namespace volalign {

/// What a run learns from and is scored on.
struct TrainingData {
  Structure structure;
  /// Of a finite set of samples (DatasetHeader::Identity) and of recorded frames with their
  /// calibrations; a run resumes only with the same. Empty where samples depend on configuration
  /// and seed alone.
  std::string identity;
  /// What draws the samples, for people; empty where all are read. The name of the choice is in
  /// `renderer`: data.renderer with `auto` decided.
  std::string drawn_by, renderer;
  /// The run's samples from number `first_sample` on, a multiple of the batch size; of each batch
  /// the slice of this process.
  std::function<std::unique_ptr<SampleSource>(std::int64_t first_sample)> open_training;
  /// The samples that no step has seen, from the first; the same ones each time.
  std::function<std::unique_ptr<SampleSource>()> open_validation;
  /// Of them there are so many; 0: as many as are asked for.
  int validation_frames = 0;
};

/// Samples that are rendered as they are drawn, or read from run.dataset and
/// run.validation_dataset; of each batch those of `slice`. Throws ConfigError for a dataset of
/// another recipe or structure or a validation set that shares samples with the training set,
/// IoError where validation would render and nothing can.
TrainingData OpenTrainingData(const TrainConfig& config, const BatchSlice& slice = {});

}  // namespace volalign

#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/base/batch_slice.h"
#include "core/geometry/camera.h"
#include "core/geometry/structure.h"
#include "render/depth_renderer.h"
#include "train/batch.h"
#include "train/train_config.h"

namespace volalign {

class Dataset;

/// The samples of a run, for training and for validation.
struct TrainingData {
  Structure structure;
  std::vector<IntrinsicsPoolEntry> intrinsics;  ///< of the recipe's sensors
  /// Identity of a finite set of samples (DatasetHeader::Identity) and of recorded frames with
  /// their calibrations. A run resumes only with the same. Empty if samples depend only on
  /// configuration and seed.
  std::string identity;
  std::string drawn_by;  ///< program that draws the samples, for people; empty if all are read
  RendererKind renderer = RendererKind::kEgl;  ///< data.renderer with `auto` decided
  /// Opens the run's samples from number `first_sample` on, a multiple of the batch size. Only this
  /// process's slice of each batch.
  std::function<SampleSource(std::int64_t first_sample)> open_training;
  /// Opens the validation samples, which no step has seen, from the first; the same ones each time.
  std::function<SampleSource()> open_validation;
  /// Number of validation samples; 0: as many as are asked for.
  int validation_frames = 0;
};

/// Samples of `seed` from `first_index` on, of each batch those of `slice`. The run's loader
/// threads render them with the results of `renderers`.
SampleSource RenderedSamples(std::shared_ptr<const SampleContext> context, const RunConfig& run,
                             RendererFactory renderers, std::uint64_t seed,
                             std::uint64_t first_index, const BatchSlice& slice = {});

struct DatasetOrder {
  std::uint64_t seed = 0;  ///< of the order in epochs 1, 2, ...
  /// Samples of the stream to skip, a multiple of batch_size.
  std::uint64_t first_sample = 0;
  int batch_size = 16;
  int num_threads = 1;
  BatchSlice slice = {};
  int prefetch = 4;  ///< batches read ahead
};

/// Batches of a dataset on disk, or their slices, read ahead on threads. The stream is endless.
/// Epoch 0 has the dataset's batches in their order, so it equals the rendered stream that was
/// written. Later epochs have an order that depends only on (seed, epoch). A batch always has the
/// same neighbouring samples, as it has one image size. Throws ConfigError if the dataset has
/// several image sizes and `batch_size` does not divide its own, or if it has no whole batch.
/// Throws Error for bad options. The source rethrows a reading thread's exception (Dataset::Read).
SampleSource DatasetSamples(std::shared_ptr<const Dataset> dataset, const DatasetOrder& options);

/// Number of whole batches in an epoch of DatasetSamples. Throws its ConfigErrors.
std::uint64_t CountBatches(const Dataset& dataset, int batch_size);

/// Samples that are rendered as they are drawn, or read from run.dataset and
/// run.validation_dataset; of each batch those of `slice`. Throws ConfigError for a dataset of
/// another recipe or structure, or a validation set that shares samples with the training set.
/// Throws IoError if validation would render and nothing can.
TrainingData OpenTrainingData(const TrainConfig& config, const BatchSlice& slice = {});

}  // namespace volalign

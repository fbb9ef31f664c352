#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/batch_slice.h"
#include "render/dataset.h"
#include "train/batch.h"

namespace volalign {

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

}  // namespace volalign

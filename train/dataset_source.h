#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/batch_slice.h"
#include "core/base/ordered_prefetch.h"
#include "render/dataset.h"
#include "train/batch.h"

namespace volalign {

/// Batches of a dataset on disk, read ahead on threads. The stream is endless. Epoch 0 has the
/// dataset's batches in their order, so it equals the rendered stream that was written. Later
/// epochs have an order that depends only on (seed, epoch). A batch always has the same
/// neighbouring samples, as it has one image size.
class DatasetSource : public SampleSource {
 public:
  struct Options {
    std::uint64_t seed = 0;  ///< of the order in epochs 1, 2, ...
    /// Samples of the stream to skip, a multiple of batch_size.
    std::uint64_t first_sample = 0;
    int batch_size = 16;
    int num_threads = 1;
    BatchSlice slice = {};
    int prefetch = 4;  ///< batches read ahead
  };
  /// Throws ConfigError if the dataset has several image sizes and `batch_size` does not divide its
  /// own, or if it has no whole batch. Throws Error for bad options.
  DatasetSource(std::shared_ptr<const Dataset> dataset, const Options& options);

  /// The next batch, or its slice. Rethrows a reading thread's exception (Dataset::Read).
  std::vector<Sample> Next() override;

 private:
  std::unique_ptr<OrderedPrefetch<std::vector<Sample>>> batches_;
};

/// Number of whole batches in an epoch of a DatasetSource. Throws its ConfigErrors.
std::uint64_t CountBatches(const Dataset& dataset, int batch_size);

}  // namespace volalign

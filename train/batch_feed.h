#pragma once

#include <memory>

#include "core/base/ordered_prefetch.h"
#include "train/batch.h"

namespace volalign {

/// A batch that is ready on its device.
struct FedBatch {
  Batch batch;
  std::vector<Intrinsics> cameras;  ///< of each sample
};

/// A source's batches on a device.
class BatchFeed {
 public:
  /// Batches that are packed and copied to a CUDA device while an earlier one is in training.
  static constexpr int kAhead = 2;

  /// A thread packs `ahead` batches, and a stream copies them. 0: each batch is packed when it is
  /// needed.
  BatchFeed(std::unique_ptr<SampleSource> source, const at::Device& device, int ahead);

  /// The next batch. The current stream waits for it; the calling thread does not wait for the
  /// device. Rethrows exceptions of the source.
  FedBatch Next();

 private:
  struct Arrival;
  using Arrivals = OrderedPrefetch<std::shared_ptr<Arrival>>;
  std::shared_ptr<Arrival> Fetch();

  std::unique_ptr<SampleSource> source_;
  at::Device device_;
  BatchPacker packer_;
  std::unique_ptr<Arrivals> ahead_;  ///< last: its thread uses the others
};

}  // namespace volalign

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
  /// Batches that are packed and copied to a CUDA device while the one before is trained on.
  static constexpr int kAhead = 2;

  /// `ahead` batches are packed by a thread of their own and copied on a stream of their own; 0:
  /// none, each is packed when it is asked for.
  BatchFeed(std::unique_ptr<SampleSource> source, const at::Device& device, int ahead);

  /// The next batch; the current stream waits for it, the calling thread does not wait for the
  /// device. Rethrows what the source throws.
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

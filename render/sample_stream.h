#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "core/base/batch_slice.h"
#include "core/base/ordered_prefetch.h"
#include "render/depth_renderer.h"
#include "render/sample.h"

namespace volalign {

/// Draws batches of consecutive samples on worker threads, each with its own renderer. Batches come
/// in order for any number of threads. At most `prefetch` finished batches wait in memory.
class SampleStream {
 public:
  /// `first_index` must be a multiple of context.batch_size, else Error.
  struct Options {
    std::uint64_t seed = 0;
    std::uint64_t first_index = 0;
    int num_threads = 1;
    RendererFactory make_renderer = nullptr;  ///< called by each worker thread; required
    BatchSlice slice = {};
    std::function<void(const Sample&)> drawn = nullptr;  ///< called by the worker, for each sample
    int prefetch = 4;
  };
  SampleStream(std::shared_ptr<const SampleContext> context, const Options& options);

  /// The next context.batch_size samples, or those of the slice. Rethrows a worker's exception.
  std::vector<Sample> Next();
  /// The next sample alone. Rethrows a worker's exception.
  Sample NextSample();

 private:
  int count_ = 1;
  std::unique_ptr<OrderedPrefetch<Sample>> samples_;
};

}  // namespace volalign

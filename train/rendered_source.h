#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "render/sample_stream.h"
#include "train/batch.h"
#include "train/train_config.h"

namespace volalign {

/// Samples of `seed` from `first_index` on, of each batch those of `slice`. The run's loader
/// threads render them with the results of `renderers`.
class RenderedSource : public SampleSource {
 public:
  RenderedSource(std::shared_ptr<const SampleContext> context, const RunConfig& run,
                 RendererFactory renderers, std::uint64_t seed, std::uint64_t first_index,
                 const BatchSlice& slice = {})
      : stream_(std::move(context),
                {seed, first_index, run.loader_threads, std::move(renderers), slice}) {}
  std::vector<Sample> Next() override { return stream_.Next(); }

 private:
  SampleStream stream_;
};

}  // namespace volalign

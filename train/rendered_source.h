#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "render/egl/gl_depth_renderer.h"
#include "render/sample_stream.h"
#include "train/batch.h"
#include "train/train_config.h"

namespace volalign {

/// Samples of `seed` from `first_index` on, of each batch those of `slice`, rendered on the run's
/// loader threads.
class RenderedSource : public SampleSource {
 public:
  RenderedSource(std::shared_ptr<const SampleContext> context, const RunConfig& run,
                 std::uint64_t seed, std::uint64_t first_index, const BatchSlice& slice = {})
      : stream_(std::move(context),
                {seed, first_index, run.loader_threads, run.prefetch, GlRenderers(), slice}) {}
  std::vector<Sample> Next() override { return stream_.Next(); }

 private:
  SampleStream stream_;
};

}  // namespace volalign

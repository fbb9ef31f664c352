#include "render/sample_stream.h"

#include <fmt/format.h>

#include "core/error.h"
#include "render/depth_renderer.h"
#include "render/egl_context.h"

namespace volalign {
namespace {

/// A thread's GL, the renderer's objects destroyed first.
struct ThreadRenderer {
  explicit ThreadRenderer(const EglContextOptions& options) : egl(options) {}
  EglContext egl;
  DepthRenderer renderer;
};

}  // namespace

SampleStream::SampleStream(std::shared_ptr<const SampleContext> context, const Options& options) {
  if (context == nullptr) throw Error("SampleStream: no context");
  if (options.num_threads < 1 || options.prefetch < 1) {
    throw Error(
        fmt::format("SampleStream: num_threads = {} and prefetch = {} violate num_threads >= 1, "
                    "prefetch >= 1",
                    options.num_threads, options.prefetch));
  }
  batch_size_ = context->batch_size;
  if (options.first_index % static_cast<std::uint64_t>(batch_size_) != 0) {
    throw Error(fmt::format("SampleStream: first_index = {} is not a multiple of the batch size {}",
                            options.first_index, batch_size_));
  }
  const auto make_renderer = [context = std::move(context), options] {
    EglContextOptions egl_options;
    egl_options.device = options.device;
    return [context, seed = options.seed, begun = options.begun,
            gl = std::make_shared<ThreadRenderer>(egl_options)](std::uint64_t index) {
      if (begun) ++*begun;
      return Synthesize(*context, gl->renderer, seed, index);
    };
  };
  samples_ = std::make_unique<OrderedPrefetch<Sample>>(
      OrderedPrefetch<Sample>::Options{options.first_index, batch_size_, options.prefetch,
                                       options.num_threads},
      make_renderer);
}

std::vector<Sample> SampleStream::Next() {
  std::vector<Sample> batch;
  batch.reserve(static_cast<std::size_t>(batch_size_));
  for (int i = 0; i < batch_size_; ++i) batch.push_back(samples_->Take());
  return batch;
}

}  // namespace volalign

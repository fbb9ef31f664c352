#include "render/sample_stream.h"

#include <fmt/format.h>

#include "core/base/error.h"
#include "render/depth_renderer.h"

namespace volalign {

SampleStream::SampleStream(std::shared_ptr<const SampleContext> context, const Options& options) {
  if (context == nullptr) throw Error("SampleStream: no context");
  if (!options.make_renderer) throw Error("SampleStream: no renderer");
  const auto batch_size = static_cast<std::uint64_t>(context->batch_size);
  if (options.first_index % batch_size != 0) {
    throw Error(fmt::format("SampleStream: first_index = {} is not a multiple of the batch size {}",
                            options.first_index, batch_size));
  }
  const BatchSlice slice = options.slice;
  count_ = slice.count > 0 ? slice.count : context->batch_size;
  if (slice.first < 0 || slice.first + count_ > context->batch_size) {
    throw Error(fmt::format("SampleStream: {} samples from {} on are no slice of a batch of {}",
                            count_, slice.first, batch_size));
  }
  // Positions count this stream's samples, with `count` per batch.
  const auto count = static_cast<std::uint64_t>(count_);
  const auto make_renderer = [context = std::move(context), options, slice, batch_size, count] {
    return [context, seed = options.seed, drawn = options.drawn,
            renderer = std::shared_ptr<DepthRenderer>(options.make_renderer()), batch_size, count,
            first = static_cast<std::uint64_t>(slice.first)](std::uint64_t position) {
      const std::uint64_t index = position / count * batch_size + first + position % count;
      Sample sample = Synthesize(*context, *renderer, seed, index);
      if (drawn) drawn(sample);
      return sample;
    };
  };
  samples_ = std::make_unique<OrderedPrefetch<Sample>>(
      OrderedPrefetch<Sample>::Options{options.first_index / batch_size * count, count_,
                                       options.prefetch, options.num_threads},
      make_renderer);
}

std::vector<Sample> SampleStream::Next() {
  std::vector<Sample> batch;
  batch.reserve(static_cast<std::size_t>(count_));
  for (int i = 0; i < count_; ++i) batch.push_back(NextSample());
  return batch;
}

Sample SampleStream::NextSample() { return samples_->Take(); }

}  // namespace volalign

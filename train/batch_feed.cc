#include "train/batch_feed.h"

#include <c10/core/Event.h>
#include <c10/core/StreamGuard.h>
#include <c10/core/impl/VirtualGuardImpl.h>

#include <optional>
#include <utility>

namespace volalign {

struct BatchFeed::Arrival {
  PackedBatch packed;
  std::optional<c10::Event> copied;  ///< if a stream of its own copies it
};

BatchFeed::BatchFeed(std::unique_ptr<SampleSource> source, const at::Device& device, int ahead)
    : source_(std::move(source)), device_(device), packer_(device) {
  if (ahead == 0) return;
  Arrivals::Options options;
  options.prefetch = ahead;
  ahead_ = std::make_unique<Arrivals>(options, [this] {
    std::optional<c10::Stream> stream;
    if (!device_.is_cpu()) {
      stream = c10::impl::VirtualGuardImpl(device_.type()).getStreamFromGlobalPool(device_);
    }
    return [this, stream](std::uint64_t) {
      c10::OptionalStreamGuard on_stream;
      if (stream) on_stream.reset_stream(*stream);
      std::shared_ptr<Arrival> arrival = Fetch();
      if (stream) arrival->copied.emplace(device_.type()).record(*stream);
      return arrival;
    };
  });
}

std::shared_ptr<BatchFeed::Arrival> BatchFeed::Fetch() {
  auto arrival = std::make_shared<Arrival>();
  PackedBatch& packed = arrival->packed;
  packed = packer_.Pack(source_->Next());
  packed.depth = packed.depth.to(device_, /*non_blocking=*/true);
  packed.labels = packed.labels.to(device_, /*non_blocking=*/true);
  return arrival;
}

FedBatch BatchFeed::Next() {
  const std::shared_ptr<Arrival> arrival = ahead_ ? ahead_->Take() : Fetch();
  PackedBatch& packed = arrival->packed;
  if (arrival->copied) {
    const c10::Stream current = c10::impl::VirtualGuardImpl(device_.type()).getStream(device_);
    arrival->copied->block(current);
    // The allocator may reuse their memory only when this stream, too, has finished with them.
    packed.depth.record_stream(current);
    packed.labels.record_stream(current);
    for (const at::Tensor& rays : packed.rays) rays.record_stream(current);
  }
  return {Unpack(packed), std::move(packed.cameras)};
}

}  // namespace volalign

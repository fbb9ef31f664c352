#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <functional>
#include <vector>

#include "render/recent_lenses.h"
#include "render/sample.h"

namespace volalign {

/// Consecutive samples, one batch per call, all of one image size: the rendered stream, a dataset,
/// or the samples of a test.
using SampleSource = std::function<std::vector<Sample>()>;

struct Batch {
  at::Tensor depth;   ///< [B,1,H,W] float32, m
  at::Tensor labels;  ///< [B,H,W] int64
  at::Tensor rays;    ///< [B,2,H,W] float32, (x/z, y/z) of each pixel; 0 without a ray
  std::vector<Intrinsics> cameras = {};  ///< of each sample

  /// Samples [first, first + count), without a copy and without cameras.
  Batch Narrow(std::int64_t first, std::int64_t count) const;
};

/// Packs samples for a device, with the rays of their cameras through their lenses. A pixel without
/// a ray counts as one without depth. Rays are computed and copied to the device once per camera,
/// as a pool has few.
class BatchPacker {
 public:
  explicit BatchPacker(const at::Device& device) : device_(device) {}

  /// A batch whose labels are still uint8. Its depth and labels are still in memory. This is pinned
  /// if the device is not the CPU, so that copies do not block. Throws Error for no samples, or
  /// images of unequal sizes.
  Batch Pack(const std::vector<Sample>& samples);

 private:
  struct Camera {
    std::vector<std::uint8_t> has_ray;  ///< per pixel; empty: all have one
    at::Tensor rays;                    ///< [2,H,W] float32 on the device
  };
  const Camera& Of(const Intrinsics& intrinsics);

  at::Device device_;
  RecentLenses<Camera> cameras_;
};

/// The samples' values, bit for bit, on the device of the rays.
Batch Unpack(const Batch& packed);

/// A source's batches on a device, one per call. A thread packs `ahead` batches; 0: each is packed
/// when it is needed. Does not wait for the device. Rethrows exceptions of the source.
std::function<Batch()> FeedBatches(SampleSource source, const at::Device& device, int ahead);

}  // namespace volalign

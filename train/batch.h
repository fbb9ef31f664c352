#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <deque>
#include <vector>

#include "render/sample.h"

namespace volalign {

/// Consecutive samples, a batch a call: the rendered stream, or whatever a test trains on.
class SampleSource {
 public:
  virtual ~SampleSource() = default;
  /// The next batch; all samples have the same image size.
  virtual std::vector<Sample> Next() = 0;
};

struct Batch {
  at::Tensor depth;   ///< [B,1,H,W] float32, m
  at::Tensor labels;  ///< [B,H,W] int64
  at::Tensor rays;    ///< [B,2,H,W] float32, (x/z, y/z) of each pixel; 0 where it has none

  /// Samples [first, first + count), without a copy.
  Batch Narrow(std::int64_t first, std::int64_t count) const;
};

/// A batch on its way to a device, in as few bytes as hold it.
struct PackedBatch {
  /// [B,1,H,W]: int16, mm, where that loses nothing (render/noise.h: RoundKept), else float32, m.
  at::Tensor depth;
  at::Tensor labels;                ///< [B,H,W] uint8
  std::vector<at::Tensor> rays;     ///< of each sample, [2,H,W] float32, on the device already
  std::vector<Intrinsics> cameras;  ///< of each sample
};

/// Packs samples for a device, with the rays of their cameras, lens included. A pixel that the lens
/// gives no ray counts as one without depth. Rays are computed and copied to the device once for
/// each camera, of which a pool has few.
class BatchPacker {
 public:
  explicit BatchPacker(const at::Device& device) : device_(device) {}

  /// Where the device is not the CPU the images are in pinned memory, from which copies need not be
  /// waited for. Throws Error for no samples, or images of unequal sizes.
  PackedBatch Pack(const std::vector<Sample>& samples);

 private:
  struct Camera {
    Intrinsics intrinsics;
    std::vector<std::uint8_t> has_ray;  ///< of each pixel; empty: all have
    at::Tensor rays;                    ///< [2,H,W] float32 on the device
  };
  const Camera& Of(const Intrinsics& intrinsics);

  at::Device device_;
  std::deque<Camera> cameras_;
};

/// On the device of the rays: the samples' values, bit for bit.
Batch Unpack(const PackedBatch& packed);

/// Unpack of Pack on the CPU, with what it throws.
Batch Collate(const std::vector<Sample>& samples);

}  // namespace volalign

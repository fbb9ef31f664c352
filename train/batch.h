#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <vector>

#include "render/recent_lenses.h"
#include "render/sample.h"

namespace volalign {

/// Consecutive samples, one batch per call: the rendered stream, or the samples of a test.
class SampleSource {
 public:
  virtual ~SampleSource() = default;
  /// The next batch; all samples have the same image size.
  virtual std::vector<Sample> Next() = 0;
};

struct Batch {
  at::Tensor depth;   ///< [B,1,H,W] float32, m
  at::Tensor labels;  ///< [B,H,W] int64
  at::Tensor rays;    ///< [B,2,H,W] float32, (x/z, y/z) of each pixel; 0 without a ray

  /// Samples [first, first + count), without a copy.
  Batch Narrow(std::int64_t first, std::int64_t count) const;
};

/// A batch on its way to a device, with as few bytes as possible.
struct PackedBatch {
  /// [B,1,H,W]: int16, mm, if that is exact (render/noise.h: RoundKept), else float32, m.
  at::Tensor depth;
  at::Tensor labels;                ///< [B,H,W] uint8
  std::vector<at::Tensor> rays;     ///< of each sample, [2,H,W] float32, on the device already
  std::vector<Intrinsics> cameras;  ///< of each sample
};

/// Packs samples for a device, with the rays of their cameras through their lenses. A pixel without
/// a ray counts as one without depth. Rays are computed and copied to the device once per camera,
/// as a pool has few.
class BatchPacker {
 public:
  explicit BatchPacker(const at::Device& device) : device_(device) {}

  /// If the device is not the CPU, images are in pinned memory, so that copies do not block. Throws
  /// Error for no samples, or images of unequal sizes.
  PackedBatch Pack(const std::vector<Sample>& samples);

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
Batch Unpack(const PackedBatch& packed);

/// Unpack of Pack on the CPU. Throws as Pack.
Batch Collate(const std::vector<Sample>& samples);

}  // namespace volalign

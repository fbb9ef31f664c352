#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
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

  Batch To(const at::Device& device) const;
  /// Samples [first, first + count), without a copy.
  Batch Narrow(std::int64_t first, std::int64_t count) const;
};

/// Copies samples into tensors, with the rays of their cameras, lens included. A pixel that the
/// lens gives no ray counts as one without depth. Throws Error for no samples, or images of unequal
/// sizes.
Batch Collate(const std::vector<Sample>& samples);

}  // namespace volalign

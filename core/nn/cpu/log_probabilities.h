#pragma once

#include <ATen/core/Tensor.h>

namespace volalign {

/// log_softmax over the classes of logits [B,K,H,W], float32 or bfloat16: [B,K,H,W] float32,
/// contiguous.
at::Tensor LogProbabilities(const at::Tensor& logits);

}  // namespace volalign

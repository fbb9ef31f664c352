#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>

namespace volalign {

/// Convolves x [B,I,H,W] with weight [O,I,K,K] at stride 1, `padding` pixels on all sides, computed
/// in `type`. Adds bias [O] if defined. Returns [B,O,H',W'].
at::Tensor Convolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type,
                    std::int64_t padding, const at::Tensor& bias = {});

}  // namespace volalign

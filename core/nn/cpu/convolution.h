#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>

namespace volalign {

/// x [B,I,H,W] convolved with weight [O,I,K,K] at stride 1, `padding` pixels on all sides, computed
/// in `type`: [B,O,H',W'], plus bias [O] if that is defined.
at::Tensor Convolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type,
                    std::int64_t padding, const at::Tensor& bias = {});

}  // namespace volalign

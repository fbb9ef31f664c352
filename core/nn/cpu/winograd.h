#pragma once

#include <ATen/core/Tensor.h>

namespace volalign {

/// Whether WinogradConvolve can take x and weight, and computes their convolution in `type`
/// faster than oneDNN: kernels of 3x3 or 2x2 and multiples of 16 channels, x on the CPU in
/// channels-last order and with not so few pixels that the weight's transformation outweighs all,
/// float32 on a processor
/// with AVX2, or bfloat16 on one with AVX512-BF16 and without AMX.
bool WinogradSuits(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type);

/// x [B,I,H,W] convolved with weight [O,I,k,k] (float32), k = 3 or 2, at stride 1, one pixel of
/// zeros around x, computed in `type`: [B,O,H,W] or [B,O,H+1,W+1] of it in channels-last order,
/// with gradients of x and weight. By Winograd's algorithms F(2x2, 3x3) and F(2x2, 2x2)
/// (core/nn/simd/winograd_kernels.h), which round other intermediate values than a sum of products
/// does: in bfloat16 the result's error is about twice as large.
at::Tensor WinogradConvolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type);

}  // namespace volalign

#pragma once

#include <ATen/core/Tensor.h>

namespace volalign {

/// Whether WinogradConvolve can take x and weight, and computes their convolution in `type`
/// faster than oneDNN: 3x3 kernels and multiples of 32 channels, x on the CPU in channels-last
/// order and with at least twice as many pixels as channels, float32 on a processor with AVX2, or
/// bfloat16 on one with AVX512-BF16 and without AMX.
bool WinogradSuits(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type);

/// x [B,I,H,W] convolved with weight [O,I,3,3] (float32) at stride 1, one pixel of zeros around x,
/// computed in `type`: [B,O,H,W] of it in channels-last order, with gradients of x and weight. By
/// Winograd's algorithm F(2x2, 3x3) (core/simd/winograd_kernels.h), which rounds other
/// intermediate values than a sum of products does: in bfloat16 the result's error is about twice
/// as large.
at::Tensor WinogradConvolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type);

}  // namespace volalign

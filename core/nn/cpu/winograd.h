#pragma once

#include <ATen/core/Tensor.h>

#include "core/nn/cpu/winograd_kernels.h"

namespace volalign {

/// Can WinogradConvolve compute the convolution of x and weight in `type`, and faster than oneDNN?
/// It needs kernels of 3x3 or 2x2, multiples of 16 channels, and x on the CPU in channels-last
/// order. There have to be enough pixels that the transformation of the weight is not most of the
/// work. The type has to be float32 on a processor with AVX2, or bfloat16 on one with AVX512-BF16
/// and without AMX, whose matrix instructions make the direct convolution faster.
bool WinogradSuits(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type);

/// Convolves x [B,I,H,W] with weight [O,I,k,k] (float32), k = 3 or 2, at stride 1, with one pixel
/// of zeros around x, computed in `type`. Returns [B,O,H,W] for k = 3 or [B,O,H+1,W+1] for k = 2 in
/// channels-last order, with gradients of x and weight. By Winograd's algorithms F(2x2, 3x3) and
/// F(2x2, 2x2) (core/nn/cpu/winograd_kernels.h). They round other intermediate values than a sum of
/// products: in bfloat16 the error is about twice as large.
at::Tensor WinogradConvolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type);

namespace winograd {

/// For x [samples,in,height,width] in channels-last order.
Maps MapsOf(const at::Tensor& x, std::int64_t out, std::int64_t kernel, std::int64_t padding);

/// The kernels of float32.
const KernelSets<Kernels>& AllKernels();

}  // namespace winograd
}  // namespace volalign

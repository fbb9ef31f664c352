#pragma once

#include <ATen/core/Tensor.h>

namespace volalign {

/// The weight [4C,I,2,2] with which a convolution with padding 1 gives the four phases of what the
/// 3x3 convolution `weight` [C,I,3,3] (float32, on the CPU) gives after its input is enlarged
/// twofold by repetition: 16 multiplications instead of 36. Differentiable.
at::Tensor PhaseWeight(const at::Tensor& weight);

}  // namespace volalign

#pragma once

#include <ATen/core/Tensor.h>

namespace volalign {

/// The weight [4C,I,2,2] of a convolution with padding 1 on a small map. It gives the four phases
/// of the 3x3 convolution `weight` [C,I,3,3] (float32, on the CPU) on the map enlarged twofold by
/// repetition. It takes 16 multiplications instead of 36. Differentiable.
at::Tensor PhaseWeight(const at::Tensor& weight);

}  // namespace volalign

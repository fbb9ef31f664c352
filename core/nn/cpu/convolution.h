#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>

namespace volalign {

/// Convolves x [B,I,H,W] with weight [O,I,K,K] at stride 1, `padding` pixels on all sides, computed
/// in `type`. Adds bias [O] if defined. Returns [B,O,H',W'].
at::Tensor Convolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type,
                    std::int64_t padding, const at::Tensor& bias = {});

/// The weight [4C,I,2,2] of a convolution with padding 1 on a small map. It gives the four phases
/// of the 3x3 convolution `weight` [C,I,3,3] on the map enlarged twofold by repetition. It takes 16
/// multiplications instead of 36.
at::Tensor PhaseWeight(const at::Tensor& weight);

/// The map [B,C,2h,2w] from its four phases [B,4C,h+1,w+1]. Pixel (2y+i, 2x+j) is that of phase
/// 2i + j at (y+i, x+j).
at::Tensor FromPhases(const at::Tensor& phases);

/// `x` [B,C,H,W] if its values lie in the order [B,H,W,C] without gaps, else such a copy.
at::Tensor ChannelsLast(const at::Tensor& x);

}  // namespace volalign

#include "core/nn/cpu/convolution.h"

#include <ATen/ops/conv2d.h>

namespace volalign {

at::Tensor Convolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type,
                    std::int64_t padding, const at::Tensor& bias) {
  // On one thread, LibTorch computes a 1x1 convolution of a small float32 batch without oneDNN, by
  // copying the map into a matrix: this makes a whole training step 2.7 times as long. A dilated
  // one it leaves to oneDNN, and a kernel of one pixel has nothing to dilate.
  const std::int64_t dilation = weight.size(2) == 1 && weight.size(3) == 1 && x.is_cpu() ? 2 : 1;
  return at::conv2d(x.to(type), weight.to(type), bias.defined() ? bias.to(type) : bias,
                    /*stride=*/1, padding, dilation);
}

}  // namespace volalign

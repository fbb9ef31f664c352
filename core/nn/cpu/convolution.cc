#include "core/nn/cpu/convolution.h"

#include <ATen/ops/constant_pad_nd.h>
#include <ATen/ops/conv2d.h>

#include "core/base/processor.h"

namespace volalign {

at::Tensor Convolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type,
                    std::int64_t padding, const at::Tensor& bias) {
  const bool one_pixel = weight.size(2) == 1 && weight.size(3) == 1 && x.is_cpu();
  const std::int64_t channels = weight.size(0);
  // oneDNN has bfloat16 from AVX-512 on. Without it, LibTorch adds up the gradient of the weights
  // in bfloat16, which is then off by a quarter.
  if (type == at::kBFloat16 && x.is_cpu() && !ThisProcessor().avx512)
    return Convolve(x.to(type), weight.to(type), at::kFloat, padding, bias).to(type);
  // oneDNN 2.6.3 on a processor with AVX512-BF16 has a fault: a 1x1 convolution with an odd number
  // of channels has a wrong gradient of x. It was seen in maps of 90x160 and other sizes. So a
  // channel of zeros is added.
  if (one_pixel && type == at::kBFloat16 && channels % 2 == 1) {
    const at::Tensor even = bias.defined() ? at::constant_pad_nd(bias, {0, 1}) : bias;
    return Convolve(x, at::constant_pad_nd(weight, {0, 0, 0, 0, 0, 0, 0, 1}), type, padding, even)
        .narrow(1, 0, channels);
  }
  // On one thread, LibTorch computes a 1x1 convolution of a small float32 batch without oneDNN: it
  // copies the map into a matrix. A whole training step then takes 2.7 times as long. Dilated
  // convolutions go to oneDNN, and dilation has no effect on a kernel of one pixel.
  return at::conv2d(x.to(type), weight.to(type), bias.defined() ? bias.to(type) : bias,
                    /*stride=*/1, padding, /*dilation=*/one_pixel ? 2 : 1);
}

}  // namespace volalign

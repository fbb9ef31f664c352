#include "core/nn/cpu/convolution.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/cat.h>
#include <ATen/ops/constant_pad_nd.h>
#include <ATen/ops/conv2d.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/stack.h>

#include <vector>

#include "core/base/processor.h"

namespace volalign {
namespace {

/// The sums of three taps that reach the same pixel of the small map along `dim`, for the first and
/// the second pixel of a pair.
std::vector<at::Tensor> SumsOfTaps(const at::Tensor& weight, std::int64_t dim) {
  const auto tap = [&](std::int64_t i) { return weight.select(dim, i); };
  return {at::stack({tap(0), tap(1) + tap(2)}, dim), at::stack({tap(0) + tap(1), tap(2)}, dim)};
}

}  // namespace

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

at::Tensor PhaseWeight(const at::Tensor& weight) {
  std::vector<at::Tensor> phases;
  for (const at::Tensor& rows : SumsOfTaps(weight, 2)) {
    for (const at::Tensor& sums : SumsOfTaps(rows, 3)) phases.push_back(sums);
  }
  return at::cat(phases);
}

at::Tensor FromPhases(const at::Tensor& phases) {
  const std::int64_t channels = phases.size(1) / 4, height = phases.size(2) - 1,
                     width = phases.size(3) - 1;
  const auto pixels = [&](std::int64_t i, std::int64_t j) {  // [B,h,w,C]
    return phases.narrow(1, (2 * i + j) * channels, channels)
        .narrow(2, i, height)
        .narrow(3, j, width)
        .permute({0, 2, 3, 1});
  };
  const auto row = [&](std::int64_t i) { return at::stack({pixels(i, 0), pixels(i, 1)}, 3); };
  return at::stack({row(0), row(1)}, 2)
      .reshape({phases.size(0), 2 * height, 2 * width, channels})
      .permute({0, 3, 1, 2});
}

// By an empty tensor: contiguous keeps strides of dimensions of size 1, by which LibTorch takes a
// map of one channel for one in another order.
at::Tensor ChannelsLast(const at::Tensor& x) {
  if (x.stride(1) == 1 && x.stride(3) == x.size(1) &&
      x.is_contiguous(at::MemoryFormat::ChannelsLast))
    return x;
  return at::empty({x.size(0), x.size(2), x.size(3), x.size(1)}, x.options())
      .permute({0, 3, 1, 2})
      .copy_(x);
}

}  // namespace volalign

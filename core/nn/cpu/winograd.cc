#include "core/nn/cpu/winograd.h"

#include <ATen/Parallel.h>
#include <ATen/ops/empty.h>
#include <torch/csrc/autograd/custom_function.h>

#include <algorithm>
#include <cstdint>

#include "core/nn/cpu/map_pass.h"
#include "core/nn/cpu/torch_threads.h"
#include "core/nn/simd/winograd_kernels.h"

namespace volalign {
namespace {

/// Padding of the forward convolution.
constexpr std::int64_t kPadding = 1;

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// Numbers of channels have to be multiples of it. Weights are transformed for so many input
/// channels at a time.
constexpr std::int64_t kChannels = 16;
/// Number of tiles that the kernels compute without a rest.
constexpr std::int64_t kTiles = 24;
/// From so many input channels per thread on, a thread transforms all of y's gradient for its own.
constexpr std::int64_t kChannelsOfThread = 128;

const simd::WinogradKernels& KernelsFor(const at::Tensor& x) {
  return *simd::FindWinogradKernels(IsBf16(x));
}

simd::WinogradMaps MapsOf(const at::Tensor& x, std::int64_t out, std::int64_t kernel,
                          std::int64_t padding) {
  simd::WinogradMaps maps{kernel, padding, x.size(0), x.size(2), x.size(3), x.size(1), out};
  maps.x = x.data_ptr();
  return maps;
}

at::Tensor Bytes(std::int64_t count) { return at::empty({count}, at::kByte); }

/// The convolution of x with weight. If `backward`, the gradient of a convolution's input, where x
/// is the gradient of its output.
at::Tensor Compute(const at::Tensor& x, const at::Tensor& weight, bool backward) {
  const simd::WinogradKernels& kernels = KernelsFor(x);
  const std::int64_t kernel = weight.size(2);
  simd::WinogradMaps maps =
      MapsOf(x, weight.size(backward ? 1 : 0), kernel, backward ? kernel - 1 - kPadding : kPadding);
  const at::Tensor transformed = at::empty({maps.positions(), maps.position_stride()}, x.options());
  ForEachOnTorchThreads(maps.in / kChannels, [&](std::int64_t i) {
    kernels.transform_weight(maps, weight.data_ptr<float>(), backward, i * kChannels,
                             (i + 1) * kChannels, transformed.data_ptr());
  });
  at::Tensor y = EmptyMap({maps.samples, maps.out, maps.y_height(), maps.y_width()}, maps.out,
                          x.scalar_type());
  maps.weight = transformed.data_ptr();
  maps.y = y.data_ptr();
  const std::int64_t units = (maps.tiles() + kTiles - 1) / kTiles,
                     parts = std::min<std::int64_t>(at::get_num_threads(), units);
  ForEachOnTorchThreads(parts, [&](std::int64_t i) {
    const at::Tensor scratch = Bytes(kernels.scratch_bytes(maps));
    kernels.convolve(maps, units * i / parts * kTiles,
                     std::min(units * (i + 1) / parts * kTiles, maps.tiles()), scratch.data_ptr());
  });
  return y;
}

/// The gradient [O,I,k,k] of the weight. The work is divided into ranges of input channels. If
/// these are few, the maps are divided into parts, too, whose sums are added.
at::Tensor WeightGradient(const at::Tensor& x, const at::Tensor& of_y, std::int64_t kernel) {
  const simd::WinogradKernels& kernels = KernelsFor(x);
  simd::WinogradMaps maps = MapsOf(x, of_y.size(1), kernel, kPadding);
  maps.y = of_y.data_ptr();
  const std::int64_t threads = at::get_num_threads(), pairs = maps.pairs(),
                     units = maps.in / kChannels,
                     ranges = std::clamp<std::int64_t>(maps.in / kChannelsOfThread, 1, threads),
                     parts = std::min(threads / ranges, pairs);
  at::Tensor sums = at::empty({parts, maps.positions(), maps.position_stride()}, at::kFloat);
  ForEachOnTorchThreads(ranges * parts, [&](std::int64_t i) {
    const std::int64_t range = i % ranges, part = i / ranges,
                       first = units * range / ranges * kChannels,
                       last = units * (range + 1) / ranges * kChannels;
    const at::Tensor scratch = Bytes(kernels.gradient_scratch_bytes(maps, last - first));
    kernels.weight_gradient_sums(maps, pairs * part / parts, pairs * (part + 1) / parts, first,
                                 last, scratch.data_ptr(),
                                 sums.data_ptr<float>() + part * sums.stride(0));
  });
  sums = parts == 1 ? sums[0] : sums.sum(0);
  at::Tensor gradient = at::empty({maps.out, maps.in, kernel, kernel}, at::kFloat);
  ForEachOnTorchThreads(units, [&](std::int64_t i) {
    kernels.weight_gradient(maps, sums.data_ptr<float>(), i * kChannels, (i + 1) * kChannels,
                            gradient.data_ptr<float>());
  });
  return gradient;
}

class WinogradFunction : public torch::autograd::Function<WinogradFunction> {
 public:
  static at::Tensor forward(AutogradContext* context, const at::Tensor& given,
                            const at::Tensor& given_weight) {
    const at::Tensor x = EvenlySpaced(given, /*dense=*/true), weight = given_weight.contiguous();
    context->save_for_backward({x, weight});
    return Compute(x, weight, /*backward=*/false);
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const auto saved = context->get_saved_variables();
    const at::Tensor of_y = EvenlySpaced(gradients[0].to(saved[0].scalar_type()), /*dense=*/true);
    return {Compute(of_y, saved[1], /*backward=*/true),
            WeightGradient(saved[0], of_y, saved[1].size(2))};
  }
};

}  // namespace

bool WinogradSuits(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type) {
  const std::int64_t pixels = x.size(0) * x.size(2) * x.size(3), kernel = weight.size(2);
  return x.is_cpu() && x.is_contiguous(at::MemoryFormat::ChannelsLast) &&
         (kernel == 2 || kernel == 3) && weight.size(3) == kernel &&
         weight.size(0) % kChannels == 0 && weight.size(1) % kChannels == 0 &&
         4 * pixels >= std::max(weight.size(0), weight.size(1)) &&
         simd::FindWinogradKernels(type == at::kBFloat16) != nullptr;
}

at::Tensor WinogradConvolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type) {
  return WinogradFunction::apply(x.to(type), weight);
}

}  // namespace volalign

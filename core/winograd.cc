#include "core/winograd.h"

#include <ATen/Parallel.h>
#include <ATen/ops/empty.h>
#include <torch/csrc/autograd/custom_function.h>

#include <algorithm>
#include <cstdint>

#include "core/map_pass.h"
#include "core/simd/winograd_kernels.h"
#include "core/torch_threads.h"

namespace volalign {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr std::int64_t kChannels = 32;
/// Input channels of a weight that are transformed at a time.
constexpr std::int64_t kRows = 16;

const simd::WinogradKernels& KernelsFor(const at::Tensor& x) {
  return *simd::FindWinogradKernels(IsBf16(x));
}

simd::WinogradMaps MapsOf(const at::Tensor& x, std::int64_t out) {
  simd::WinogradMaps maps{x.size(0), x.size(2), x.size(3), x.size(1), out};
  maps.x = x.data_ptr();
  return maps;
}

at::Tensor Bytes(std::int64_t count) { return at::empty({count}, at::kByte); }

/// The convolution of x with weight or, if `backward`, the gradient of the input of one whose
/// output's gradient is x.
at::Tensor Compute(const at::Tensor& x, const at::Tensor& weight, bool backward) {
  const simd::WinogradKernels& kernels = KernelsFor(x);
  simd::WinogradMaps maps = MapsOf(x, weight.size(backward ? 1 : 0));
  const at::Tensor transformed = at::empty({16, maps.in, maps.out}, x.options());
  ForEachOnTorchThreads(maps.in / kRows, [&](std::int64_t i) {
    kernels.transform_weight(weight.data_ptr<float>(), backward, maps.in, maps.out, i * kRows,
                             (i + 1) * kRows, transformed.data_ptr());
  });
  const at::Tensor y =
      EmptyMap({maps.samples, maps.out, maps.height, maps.width}, maps.out, x.scalar_type());
  maps.weight = transformed.data_ptr();
  maps.y = y.data_ptr();
  const std::int64_t step = 4 * kernels.block_tiles(maps.in, maps.out);
  ForEachOnTorchThreads((maps.tiles() + step - 1) / step, [&](std::int64_t i) {
    const at::Tensor scratch = Bytes(kernels.scratch_bytes(maps.in, maps.out));
    kernels.convolve(maps, i * step, std::min((i + 1) * step, maps.tiles()), scratch.data_ptr());
  });
  return y;
}

/// The gradient [O,I,3,3] of the weight, summed up in as many parts as there are threads.
at::Tensor WeightGradient(const at::Tensor& x, const at::Tensor& of_y) {
  const simd::WinogradKernels& kernels = KernelsFor(x);
  simd::WinogradMaps maps = MapsOf(x, of_y.size(1));
  maps.y = of_y.data_ptr();
  const std::int64_t pairs = kernels.tile_pairs(maps),
                     parts = std::min<std::int64_t>(at::get_num_threads(), pairs);
  at::Tensor sums = at::empty({parts, 16, maps.in, maps.out}, at::kFloat);
  ForEachOnTorchThreads(parts, [&](std::int64_t i) {
    const at::Tensor scratch = Bytes(kernels.gradient_scratch_bytes(maps.in, maps.out));
    kernels.weight_gradient_sums(maps, pairs * i / parts, pairs * (i + 1) / parts,
                                 scratch.data_ptr(), sums.data_ptr<float>() + i * sums.stride(0));
  });
  sums = parts == 1 ? sums[0] : sums.sum(0);
  const at::Tensor gradient = at::empty({maps.out, maps.in, 3, 3}, at::kFloat);
  ForEachOnTorchThreads(maps.in / kRows, [&](std::int64_t i) {
    kernels.weight_gradient(sums.data_ptr<float>(), maps.in, maps.out, i * kRows, (i + 1) * kRows,
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
    return {Compute(of_y, saved[1], /*backward=*/true), WeightGradient(saved[0], of_y)};
  }
};

}  // namespace

bool WinogradSuits(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type) {
  const std::int64_t pixels = x.size(0) * x.size(2) * x.size(3);
  return x.is_cpu() && x.is_contiguous(at::MemoryFormat::ChannelsLast) && weight.size(2) == 3 &&
         weight.size(3) == 3 && weight.size(0) % kChannels == 0 &&
         weight.size(1) % kChannels == 0 && pixels >= 2 * weight.size(1) &&
         simd::FindWinogradKernels(type == at::kBFloat16) != nullptr;
}

at::Tensor WinogradConvolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type) {
  return WinogradFunction::apply(x.to(type), weight);
}

}  // namespace volalign

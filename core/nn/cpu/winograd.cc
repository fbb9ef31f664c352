#include "core/nn/cpu/winograd.h"

#include <ATen/Parallel.h>
#include <ATen/ops/empty.h>
#include <torch/csrc/autograd/custom_function.h>

#include <algorithm>
#include <cstdint>

#include "core/nn/cpu/convolution.h"
#include "core/nn/cpu/torch_threads.h"

namespace volalign {
namespace winograd {

VOLALIGN_DECLARE_KERNELS(Kernels)

const KernelSets<Kernels>& AllKernels() {
  static const KernelSets<Kernels> all = CollectKernels(baseline::Get, avx2::Get, avx512::Get);
  return all;
}

#if defined(__x86_64__)
namespace avx512bf16 {
Kernels Get();
}
#endif

namespace {

bool HasBf16() { return ThisProcessor().avx512_bf16 && !ThisProcessor().amx_bf16; }

const Kernels& KernelsFor(at::ScalarType type) {
#if defined(__x86_64__)
  if (type == at::kBFloat16) {
    static const Kernels kernels = avx512bf16::Get();
    return kernels;
  }
#endif
  return AllKernels().Best();
}

}  // namespace

Maps MapsOf(const at::Tensor& x, std::int64_t out, std::int64_t kernel, std::int64_t padding) {
  // So the positions do not fall on the same cache lines.
  constexpr std::int64_t kPositionGap = 64;
  Maps m{};
  m.kernel = kernel;
  m.padding = padding;
  m.samples = x.size(0);
  m.height = x.size(2);
  m.width = x.size(3);
  m.in = x.size(1);
  m.out = out;
  m.y_height = m.height + 2 * padding - kernel + 1;
  m.y_width = m.width + 2 * padding - kernel + 1;
  m.tile_rows = (m.y_height + 1) / 2;
  m.tile_columns = (m.y_width + 1) / 2;
  m.tiles = m.samples * m.tile_rows * m.tile_columns;
  m.pair_columns = (m.tile_columns + 1) / 2;
  m.pairs = m.samples * m.tile_rows * m.pair_columns;
  m.positions = (kernel + 1) * (kernel + 1);
  m.weight_stride = m.in * out + kPositionGap;
  // Transformed inputs and sums stay in the second-level cache. The product rounds a last block up
  // to its rows and ignores what it gets for the tiles that are too many.
  m.block_tiles = std::max<std::int64_t>(3072 / (m.in + out) / kTiles, 1) * kTiles;
  m.x_stride = m.block_tiles * m.in + kPositionGap;
  m.y_stride = m.block_tiles * out + kPositionGap;
  // So many that reading and writing the sums costs no more than the transformed maps do.
  m.block_pairs = std::max<std::int64_t>(48, m.in * out / (m.in + out));
  m.x_pairs_stride = 2 * m.block_pairs * m.in + kPositionGap;
  m.y_pairs_stride = 2 * m.block_pairs * out + kPositionGap;
  m.x = x.data_ptr();
  return m;
}

}  // namespace winograd

namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;
using winograd::kChannels;
using winograd::kTiles;

/// Padding of the forward convolution.
constexpr std::int64_t kPadding = 1;

at::Tensor EmptyMap(at::IntArrayRef size, at::ScalarType type) {
  return at::empty(size, at::TensorOptions(type).memory_format(at::MemoryFormat::ChannelsLast));
}

/// The convolution of x with weight. If `backward`, the gradient of a convolution's input, where x
/// is the gradient of its output.
at::Tensor Compute(const at::Tensor& x, const at::Tensor& weight, bool backward) {
  const winograd::Kernels& kernels = winograd::KernelsFor(x.scalar_type());
  const std::int64_t kernel = weight.size(2);
  winograd::Maps maps = winograd::MapsOf(x, weight.size(backward ? 1 : 0), kernel,
                                         backward ? kernel - 1 - kPadding : kPadding);
  const at::Tensor transformed = at::empty({maps.positions, maps.weight_stride}, x.options());
  ForEachOnTorchThreads(maps.in / kChannels, [&](std::int64_t i) {
    kernels.transform_weight(maps, weight.data_ptr<float>(), backward, i * kChannels,
                             (i + 1) * kChannels, transformed.data_ptr());
  });
  at::Tensor y = EmptyMap({maps.samples, maps.out, maps.y_height, maps.y_width}, x.scalar_type());
  maps.weight = transformed.data_ptr();
  maps.y = y.data_ptr();
  const std::int64_t units = (maps.tiles + kTiles - 1) / kTiles,
                     parts = std::min<std::int64_t>(at::get_num_threads(), units);
  ForEachOnTorchThreads(parts, [&](std::int64_t i) {
    const at::Tensor scratch = at::empty({maps.positions, maps.x_stride + maps.y_stride});
    kernels.convolve(maps, units * i / parts * kTiles,
                     std::min(units * (i + 1) / parts * kTiles, maps.tiles),
                     scratch.data_ptr<float>());
  });
  return y;
}

/// The gradient [O,I,k,k] of the weight, from the sums of a part of the maps for each thread.
at::Tensor WeightGradient(const at::Tensor& x, const at::Tensor& of_y, std::int64_t kernel) {
  const winograd::Kernels& kernels = winograd::KernelsFor(x.scalar_type());
  winograd::Maps maps = winograd::MapsOf(x, of_y.size(1), kernel, kPadding);
  maps.y = of_y.data_ptr();
  const std::int64_t parts = std::min<std::int64_t>(at::get_num_threads(), maps.pairs);
  at::Tensor sums = at::empty({parts, maps.positions, maps.weight_stride});
  ForEachOnTorchThreads(parts, [&](std::int64_t i) {
    const at::Tensor scratch =
        at::empty({maps.positions, maps.x_pairs_stride + maps.y_pairs_stride});
    kernels.weight_gradient_sums(maps, maps.pairs * i / parts, maps.pairs * (i + 1) / parts,
                                 scratch.data_ptr<float>(), sums[i].data_ptr<float>());
  });
  sums = parts == 1 ? sums[0] : sums.sum(0);
  at::Tensor gradient = at::empty({maps.out, maps.in, kernel, kernel});
  ForEachOnTorchThreads(maps.in / kChannels, [&](std::int64_t i) {
    kernels.weight_gradient(maps, sums.data_ptr<float>(), i * kChannels, (i + 1) * kChannels,
                            gradient.data_ptr<float>());
  });
  return gradient;
}

class WinogradFunction : public torch::autograd::Function<WinogradFunction> {
 public:
  static at::Tensor forward(AutogradContext* context, const at::Tensor& given,
                            const at::Tensor& given_weight) {
    const at::Tensor x = ChannelsLast(given), weight = given_weight.contiguous();
    context->save_for_backward({x, weight});
    return Compute(x, weight, /*backward=*/false);
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const auto saved = context->get_saved_variables();
    const at::Tensor of_y = ChannelsLast(gradients[0].to(saved[0].scalar_type()));
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
         (type == at::kFloat ? ThisProcessor().avx2 : winograd::HasBf16());
}

at::Tensor WinogradConvolve(const at::Tensor& x, const at::Tensor& weight, at::ScalarType type) {
  return WinogradFunction::apply(x.to(type), weight);
}

}  // namespace volalign

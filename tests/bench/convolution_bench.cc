// The network's convolutions that volalign computes by Winograd's algorithm, at 320x180: its own
// beside oneDNN's. GFLOP/s are those of the sums of products, which the algorithm does with fewer
// multiplications.

#include <ATen/ATen.h>
#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>
#include <torch/csrc/autograd/autograd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "core/nn/cpu/winograd.h"

namespace volalign {
namespace {

double Seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// The smallest time of all iterations counts.
void Convolution(benchmark::State& state, at::ScalarType type, bool winograd) {
  const std::int64_t batch = state.range(0), kernel = state.range(1), in = state.range(2),
                     out = state.range(3), height = state.range(4), width = state.range(5);
  at::set_num_threads(static_cast<int>(state.range(6)));
  const at::Tensor x = at::randn({batch, in, height, width})
                           .to(type)
                           .contiguous(at::MemoryFormat::ChannelsLast)
                           .requires_grad_(true);
  const at::Tensor weight = at::randn({out, in, kernel, kernel}).requires_grad_(true);
  if (winograd && !WinogradSuits(x, weight, type)) {
    state.SkipWithError("not by Winograd's algorithm on this processor");
    return;
  }
  double forward = 1e9, backward = 1e9;
  for (auto _ : state) {
    const double start = Seconds();
    const at::Tensor y =
        winograd ? WinogradConvolve(x, weight, type) : at::conv2d(x, weight.to(type), {}, 1, 1);
    const double middle = Seconds();
    torch::autograd::grad({y}, {x, weight}, {y.detach()});
    forward = std::min(forward, middle - start);
    backward = std::min(backward, Seconds() - middle);
  }
  const std::int64_t padding = kernel == 3 ? 0 : 1;
  const double work = 2e-9 * static_cast<double>(batch * (height + padding) * (width + padding) *
                                                 kernel * kernel * in * out);
  state.counters["forward_GFLOP/s"] = work / forward;
  state.counters["backward_GFLOP/s"] = 2 * work / backward;
}

/// Of the network of width c: 3x3, and 2x2 for the four phases of an enlargement.
void Sizes(benchmark::internal::Benchmark* b) {
  b->ArgNames({"batch", "kernel", "in", "out", "h", "w", "threads"});
  for (const std::int64_t threads : {1, 2}) {
    for (const std::int64_t c : {8, 16, 32}) {
      const std::int64_t batch = c == 32 ? 2 : 8;
      const auto add = [&](std::int64_t kernel, std::int64_t in, std::int64_t out,
                           std::int64_t height, std::int64_t width) {
        b->Args({batch, kernel, in * c, out * c, height, width, threads});
      };
      if (c > 8) add(3, 2, 1, 180, 320);
      add(3, 2, 4, 90, 160);
      add(3, 4, 4, 90, 160);
      add(3, 8, 8, 45, 80);
      add(3, 16, 16, 22, 40);
      add(3, 16, 16, 11, 20);
      add(2, 4, 8, 90, 160);
      add(2, 16, 32, 22, 40);
      add(2, 16, 64, 11, 20);
    }
  }
  b->Unit(benchmark::kMillisecond)->MinTime(0.5);
}

BENCHMARK_CAPTURE(Convolution, bf16_winograd, at::kBFloat16, true)->Apply(Sizes);
BENCHMARK_CAPTURE(Convolution, bf16_onednn, at::kBFloat16, false)->Apply(Sizes);
BENCHMARK_CAPTURE(Convolution, fp32_winograd, at::kFloat, true)->Apply(Sizes);
BENCHMARK_CAPTURE(Convolution, fp32_onednn, at::kFloat, false)->Apply(Sizes);

}  // namespace
}  // namespace volalign

BENCHMARK_MAIN();

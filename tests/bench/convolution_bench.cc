// The 3x3 convolutions of m05-lite's network at 320x180, in batches of 8 on one thread:
// WinogradConvolve beside oneDNN's. GFLOP/s are those of the sums of products, which Winograd's
// algorithm does with fewer multiplications.

#include <ATen/ATen.h>
#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>
#include <torch/csrc/autograd/autograd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "core/winograd.h"

namespace volalign {
namespace {

constexpr std::int64_t kBatch = 8;

double Seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Arguments: channels, height, width. The smallest time of all iterations counts.
void Convolution(benchmark::State& state, at::ScalarType type, bool winograd) {
  at::set_num_threads(1);
  const std::int64_t channels = state.range(0), height = state.range(1), width = state.range(2);
  const at::Tensor x = at::randn({kBatch, channels, height, width})
                           .to(type)
                           .contiguous(at::MemoryFormat::ChannelsLast)
                           .requires_grad_(true);
  const at::Tensor weight = at::randn({channels, channels, 3, 3}).requires_grad_(true);
  if (winograd && !WinogradSuits(x, weight, type)) {
    state.SkipWithError("no kernels for this processor");
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
  const double work = 2e-9 * static_cast<double>(kBatch * height * width * 9 * channels * channels);
  state.counters["forward_GFLOP/s"] = work / forward;
  state.counters["backward_GFLOP/s"] = 2 * work / backward;
}

void Sizes(benchmark::internal::Benchmark* b) {
  b->Args({32, 90, 160})->Args({64, 45, 80})->Args({128, 22, 40})->Args({128, 11, 20});
  b->Unit(benchmark::kMillisecond)->MinTime(1);
}

BENCHMARK_CAPTURE(Convolution, bf16_winograd, at::kBFloat16, true)->Apply(Sizes);
BENCHMARK_CAPTURE(Convolution, bf16_onednn, at::kBFloat16, false)->Apply(Sizes);
BENCHMARK_CAPTURE(Convolution, fp32_winograd, at::kFloat, true)->Apply(Sizes);
BENCHMARK_CAPTURE(Convolution, fp32_onednn, at::kFloat, false)->Apply(Sizes);

}  // namespace
}  // namespace volalign

BENCHMARK_MAIN();

#include "core/nn/cpu/phase_weight.h"

#include <ATen/ops/empty.h>
#include <torch/csrc/autograd/custom_function.h>

#include <cstdint>

#include "core/nn/cpu/torch_threads.h"

namespace volalign {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// Which of the two taps contains a tap of the 3x3 kernel, for the first and the second pixel of a
/// pair.
constexpr int kTap[2][3] = {{0, 1, 1}, {0, 0, 1}};

/// Calls f(kernel, phases) for each output channel o and input channel. `kernel`: the index in
/// [C,I]. `phases`: the indices of its four phases in [4C,I].
template <class F>
void ForKernels(std::int64_t out, std::int64_t in, const F& f) {
  ForEachOnTorchThreads(out, [&](std::int64_t o) {
    for (std::int64_t kernel = o * in; kernel < (o + 1) * in; ++kernel) {
      const std::int64_t step = out * in;
      const std::int64_t phases[2][2] = {{kernel, kernel + step},
                                         {kernel + 2 * step, kernel + 3 * step}};
      f(kernel, phases);
    }
  });
}

// As loops: a product of matrices would wake the threads of the matrix library. These go on waiting
// for work on processors that LibTorch's threads need.
class PhaseWeightFunction : public torch::autograd::Function<PhaseWeightFunction> {
 public:
  static at::Tensor forward(AutogradContext* /*context*/, const at::Tensor& given) {
    const at::Tensor weight = given.contiguous();
    const std::int64_t out = weight.size(0), in = weight.size(1);
    at::Tensor result = at::empty({4 * out, in, 2, 2}, at::kFloat);
    const float* from = weight.data_ptr<float>();
    float* all = result.data_ptr<float>();
    ForKernels(out, in, [&](std::int64_t kernel, const std::int64_t(&phases)[2][2]) {
      const float* taps = from + 9 * kernel;
      for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 2; ++j) {
          float sums[4] = {};
          for (int k = 0; k < 9; ++k) sums[kTap[i][k / 3] * 2 + kTap[j][k % 3]] += taps[k];
          float* to = all + 4 * phases[i][j];
          for (int k = 0; k < 4; ++k) to[k] = sums[k];
        }
      }
    });
    return result;
  }

  static variable_list backward(AutogradContext* /*context*/, variable_list gradients) {
    const at::Tensor given = gradients[0].contiguous();
    const std::int64_t out = given.size(0) / 4, in = given.size(1);
    const at::Tensor result = at::empty({out, in, 3, 3}, at::kFloat);
    const float* from = given.data_ptr<float>();
    float* all = result.data_ptr<float>();
    ForKernels(out, in, [&](std::int64_t kernel, const std::int64_t(&phases)[2][2]) {
      float sums[9] = {};
      for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 2; ++j) {
          const float* taps = from + 4 * phases[i][j];
          for (int k = 0; k < 9; ++k) sums[k] += taps[kTap[i][k / 3] * 2 + kTap[j][k % 3]];
        }
      }
      float* to = all + 9 * kernel;
      for (int k = 0; k < 9; ++k) to[k] = sums[k];
    });
    return {result};
  }
};

}  // namespace

at::Tensor PhaseWeight(const at::Tensor& weight) { return PhaseWeightFunction::apply(weight); }

}  // namespace volalign

#include "core/nn/cpu/convolution.h"

#include <ATen/ATen.h>
#include <ATen/Parallel.h>
#include <gtest/gtest.h>

namespace volalign::convolution_test {
namespace {

/// Sums over the kernel, in float64.
at::Tensor Reference(const at::Tensor& x, const at::Tensor& weight, std::int64_t padding,
                     const at::Tensor& bias) {
  const std::int64_t kernel = weight.size(2);
  const at::Tensor padded = at::constant_pad_nd(x, {padding, padding, padding, padding});
  const std::int64_t height = padded.size(2) - kernel + 1, width = padded.size(3) - kernel + 1;
  at::Tensor sum = bias.view({1, -1, 1, 1});
  for (std::int64_t v = 0; v < kernel; ++v) {
    for (std::int64_t u = 0; u < kernel; ++u) {
      sum = sum + at::einsum("bihw,oi->bohw", {padded.narrow(2, v, height).narrow(3, u, width),
                                               weight.select(3, u).select(2, v)});
    }
  }
  return sum;
}

TEST(Convolve, IsTheConvolution) {
  const int threads = at::get_num_threads();
  for (const int use : {1, 2}) {
    at::set_num_threads(use);
    for (const std::int64_t kernel : {1, 3}) {
      for (const std::int64_t batch : {1, 3, 16}) {
        const at::Tensor x = at::randn({batch, 5, 40, 37}, at::kDouble),
                         weight = at::randn({7, 5, kernel, kernel}, at::kDouble),
                         bias = at::randn({7}, at::kDouble);
        const at::Tensor ours = Convolve(x, weight.to(at::kFloat), at::kFloat, kernel / 2, bias);
        const at::Tensor expected = Reference(x, weight, kernel / 2, bias);
        ASSERT_EQ(ours.sizes(), expected.sizes());
        EXPECT_EQ(ours.scalar_type(), at::kFloat);
        EXPECT_LT((ours - expected).abs().max().item<double>(), 1e-4);
      }
    }
  }
  at::set_num_threads(threads);
}

}  // namespace
}  // namespace volalign::convolution_test

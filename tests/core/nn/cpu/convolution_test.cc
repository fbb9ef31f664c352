#include "core/nn/cpu/convolution.h"
#include "core/base/error.h"
#include "core/nn/cpu/torch_threads.h"

#include <ATen/ATen.h>
#include <ATen/Parallel.h>
#include <gtest/gtest.h>

#include <set>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

namespace volalign::convolution_test {
namespace {

/// LibTorch's, in float64.
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
        const at::Tensor expected = at::conv2d(x, weight, bias, 1, kernel / 2);
        ASSERT_EQ(ours.sizes(), expected.sizes());
        EXPECT_EQ(ours.scalar_type(), at::kFloat);
        EXPECT_LT((ours - expected).abs().max().item<double>(), 1e-4);
      }
    }
  }
  at::set_num_threads(threads);
}

/// The network's own: classes from 8 channels, and the attention's one channel.
TEST(Convolve, HasTheGradientsInBfloat16) {
  for (const std::int64_t channels : {1, 8, 21}) {
    for (const auto& [height, width] :
         {std::pair(90, 160), std::pair(144, 160), std::pair(5, 10)}) {
      const at::Tensor x = at::randn({2, 8, height, width}).to(at::kBFloat16),
                       weight = at::randn({channels, 8, 1, 1}).to(at::kBFloat16).to(at::kFloat),
                       bias = at::randn({channels}),
                       of_y = at::randn({2, channels, height, width}).to(at::kBFloat16);
      const auto gradients = [&](at::ScalarType type) {
        const at::Tensor in =
            x.to(type).contiguous(at::MemoryFormat::ChannelsLast).detach().requires_grad_();
        const at::Tensor w = weight.clone().requires_grad_(), b = bias.clone().requires_grad_();
        const at::Tensor y = Convolve(in, w, type, 0, b);
        EXPECT_EQ(y.size(1), channels);
        y.backward(of_y.to(type).contiguous(at::MemoryFormat::ChannelsLast));
        return std::vector<at::Tensor>{in.grad().to(at::kFloat), w.grad(), b.grad()};
      };
      const std::vector<at::Tensor> ours = gradients(at::kBFloat16);
      const std::vector<at::Tensor> expected = gradients(at::kFloat);
      for (std::size_t i = 0; i < ours.size(); ++i)
        EXPECT_LT(((ours[i] - expected[i]).norm() / expected[i].norm()).item<double>(), 0.01)
            << channels << " channels, " << height << "x" << width << ", gradient " << i;
    }
  }
}

/// The four phases of a convolution on a small map are the convolution on the enlarged one.
TEST(FromPhases, IsTheEnlargedConvolution) {
  const at::Tensor x = at::randn({2, 5, 6, 9}, at::kDouble),
                   weight = at::randn({8, 5, 3, 3}, at::kDouble);
  const at::Tensor ours = FromPhases(at::conv2d(x, PhaseWeight(weight), {}, 1, 1)),
                   expected = at::conv2d(at::upsample_nearest2d(x, {12, 18}), weight, {}, 1, 1);
  ASSERT_EQ(ours.sizes(), expected.sizes());
  EXPECT_LT((ours - expected).abs().max().item<double>(), 1e-12);
  EXPECT_TRUE(ours.is_contiguous(at::MemoryFormat::ChannelsLast));
}

TEST(ChannelsLast, OrdersAMapOfOneChannelToo) {
  for (const std::int64_t channels : {1, 2}) {
    const at::Tensor x = at::randn({2, channels, 3, 4}), ordered = ChannelsLast(x);
    EXPECT_TRUE(ordered.equal(x));
    EXPECT_EQ(ordered.strides(), at::IntArrayRef({12 * channels, 1, 4 * channels, channels}));
    EXPECT_EQ(ordered.suggest_memory_format(), at::MemoryFormat::ChannelsLast);
  }
}

TEST(SetTorchThreads, RefusesNegativeNumbers) {
  EXPECT_THROW(SetTorchThreads(-1), Error);
  SetTorchThreads(0);
  EXPECT_EQ(at::get_num_threads(), 1);  // of torch_test_main.cc
}

#ifdef VOLALIGN_OPENMP
TEST(ForEachOnTorchThreads, TakesAsManyThreadsAsLibTorch) {
  for (const int threads : {1, 2}) {
    SetTorchThreads(threads);
    std::vector<std::thread::id> by(8);
    ForEachOnTorchThreads(
        8, [&](std::int64_t i) { by[static_cast<std::size_t>(i)] = std::this_thread::get_id(); });
    EXPECT_EQ(std::set<std::thread::id>(by.begin(), by.end()).size(),
              static_cast<std::size_t>(threads));
  }
}
#endif

TEST(ForEachOnTorchThreads, RethrowsAnException) {
  EXPECT_THROW(ForEachOnTorchThreads(4,
                                     [](std::int64_t i) {
                                       if (i == 3) throw std::runtime_error("task 3");
                                     }),
               std::runtime_error);
}

}  // namespace
}  // namespace volalign::convolution_test

#include "core/nn/cpu/winograd.h"

#include <ATen/ATen.h>
#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>

#include <string>
#include <vector>

#include "core/base/processor.h"
namespace volalign::winograd_test {

namespace {

struct Case {
  std::int64_t kernel, samples, height, width, in, out;
};

/// Odd sizes, a single pixel, channels in blocks of 16, of 32 and of 64, more tiles than are worked
/// on at a time, and so many channels that two threads divide them.
const std::vector<Case> kCases = {
    {3, 2, 9, 7, 32, 64},   {3, 1, 1, 1, 32, 32},  {3, 3, 2, 33, 96, 32},  {3, 1, 45, 80, 64, 96},
    {3, 2, 4, 6, 128, 128}, {3, 1, 5, 9, 16, 48},  {3, 1, 6, 4, 272, 16},  {2, 2, 9, 7, 32, 64},
    {2, 1, 1, 1, 32, 32},   {2, 3, 2, 33, 48, 32}, {2, 1, 45, 80, 64, 16}, {2, 2, 6, 8, 272, 128}};

std::string Name(const Case& c) {
  return std::to_string(c.kernel) + "x" + std::to_string(c.kernel) + ", " +
         std::to_string(c.samples) + "x" + std::to_string(c.height) + "x" +
         std::to_string(c.width) + ", " + std::to_string(c.in) + " to " + std::to_string(c.out);
}

struct Inputs {
  at::Tensor x, weight, of_y;
};

/// Values that are exact in bfloat16, so that an input's rounding is nobody's error.
Inputs MakeInputs(const Case& c) {
  at::manual_seed(1);
  const auto values = [](at::IntArrayRef size) {
    return at::randn(size).to(at::kBFloat16).to(at::kFloat);
  };
  return {values({c.samples, c.in, c.height, c.width}).contiguous(at::MemoryFormat::ChannelsLast),
          values({c.out, c.in, c.kernel, c.kernel}),
          values({c.samples, c.out, c.height + 3 - c.kernel, c.width + 3 - c.kernel})};
}

/// y and the gradients of x and weight.
using Results = std::vector<at::Tensor>;

template <class Convolution>
Results Differentiate(const Inputs& in, at::ScalarType type, const Convolution& convolve) {
  const at::Tensor x = in.x.detach().to(type).requires_grad_(true),
                   weight = in.weight.detach().clone().to(type).requires_grad_(true);
  const at::Tensor y = convolve(x, weight);
  Results results = {y};
  for (const at::Tensor& g : torch::autograd::grad({y}, {x, weight}, {in.of_y.to(y.scalar_type())}))
    results.push_back(g);
  return results;
}

Results Direct(const Inputs& in, at::ScalarType type) {
  return Differentiate(in, type, [](const at::Tensor& x, const at::Tensor& weight) {
    return at::conv2d(x, weight, {}, 1, 1);
  });
}

Results ByWinograd(const Inputs& in, at::ScalarType type) {
  return Differentiate(in, at::kFloat, [type](const at::Tensor& x, const at::Tensor& weight) {
    return WinogradConvolve(x, weight, type);
  });
}

double RelativeError(const at::Tensor& ours, const at::Tensor& expected) {
  return (ours.to(at::kDouble) - expected).norm().item<double>() / expected.norm().item<double>();
}

constexpr const char* kWhat[] = {"values", "gradient of x", "gradient of the weight"};

void ExpectTheConvolutionWithItsGradients(at::ScalarType type) {
  const Inputs any = MakeInputs(kCases[0]);
  ASSERT_TRUE(WinogradSuits(any.x, any.weight, type));
  const int threads = at::get_num_threads();
  for (const Case& c : kCases) {
    const Inputs in = MakeInputs(c);
    const Results expected = Direct(in, at::kDouble), bf16 = Direct(in, at::kBFloat16);
    for (const int use : {1, 2}) {
      at::set_num_threads(use);
      const Results ours = ByWinograd(in, type);
      ASSERT_EQ(ours[0].scalar_type(), type);
      for (std::size_t i = 0; i < ours.size(); ++i) {
        const std::string what = Name(c) + ", " + kWhat[i];
        ASSERT_EQ(ours[i].sizes(), expected[i].sizes()) << what;
        const double error = RelativeError(ours[i], expected[i]),
                     allowed = type == at::kFloat ? 1e-6 : 4 * RelativeError(bf16[i], expected[i]);
        EXPECT_LT(error, allowed) << what;
      }
    }
  }
  at::set_num_threads(threads);
}

TEST(WinogradConvolve, IsTheConvolutionWithItsGradients) {
  ExpectTheConvolutionWithItsGradients(at::kFloat);
}

TEST(WinogradInBFloat16, IsTheConvolutionWithItsGradients) {
  ExpectTheConvolutionWithItsGradients(at::kBFloat16);
}

TEST(WinogradConvolve, GivesTheSameTwice) {
  const Inputs in = MakeInputs({3, 2, 20, 20, 64, 64});
  const at::ScalarType type =
      WinogradSuits(in.x, in.weight, at::kBFloat16) ? at::kBFloat16 : at::kFloat;
  const Results first = ByWinograd(in, type), second = ByWinograd(in, type);
  for (std::size_t i = 0; i < first.size(); ++i)
    EXPECT_TRUE(at::equal(first[i], second[i])) << kWhat[i];
}

/// Slices of larger tensors, as the network's joined passes give.
TEST(WinogradConvolve, TakesGradientsAndWeightsInAnyOrder) {
  const Inputs in = MakeInputs({3, 2, 8, 12, 32, 32});
  ASSERT_TRUE(WinogradSuits(in.x, in.weight, at::kFloat));
  Inputs other = in;
  other.weight = in.weight.contiguous(at::MemoryFormat::ChannelsLast);
  other.of_y =
      at::cat({in.of_y, in.of_y}, 1).contiguous(at::MemoryFormat::ChannelsLast).narrow(1, 32, 32);
  const Results expected = ByWinograd(in, at::kFloat), ours = ByWinograd(other, at::kFloat);
  for (std::size_t i = 0; i < ours.size(); ++i)
    EXPECT_TRUE(at::equal(ours[i], expected[i])) << kWhat[i];
}

TEST(WinogradSuits, OnlyWhatItCanTakeAndWhereItPays) {
  const at::Tensor x = at::zeros({2, 32, 8, 8}).contiguous(at::MemoryFormat::ChannelsLast);
  const auto weight = [](std::int64_t out, std::int64_t in, std::int64_t kernel) {
    return at::zeros({out, in, kernel, kernel});
  };
  const bool has_kernels = ThisProcessor().avx2;
  EXPECT_EQ(WinogradSuits(x, weight(32, 32, 3), at::kFloat), has_kernels);
  EXPECT_EQ(WinogradSuits(x, weight(16, 32, 2), at::kFloat), has_kernels);
  EXPECT_FALSE(WinogradSuits(x.contiguous(), weight(32, 32, 3), at::kFloat));
  EXPECT_FALSE(WinogradSuits(x, weight(32, 32, 5), at::kFloat));
  EXPECT_FALSE(WinogradSuits(x, weight(8, 32, 3), at::kFloat));
  EXPECT_FALSE(WinogradSuits(x.narrow(1, 0, 8).contiguous(at::MemoryFormat::ChannelsLast),
                             weight(32, 8, 3), at::kFloat));
  EXPECT_FALSE(WinogradSuits(x.narrow(0, 0, 1).narrow(2, 0, 1), weight(48, 32, 3), at::kFloat));
}

/// The kernels of float32 that this processor has, also those that it would not choose.
TEST(WinogradKernels, OfEachInstructionSetAreTheConvolution) {
  const KernelSets<winograd::Kernels>& all = winograd::AllKernels();
  for (const Case& c : kCases) {
    const Inputs in = MakeInputs(c);
    const Results expected = Direct(in, at::kDouble);
    for (int i = 0; i < all.count; ++i) {
      const winograd::Kernels& kernels = all.sets[i];
      winograd::Maps maps = winograd::MapsOf(in.x, c.out, c.kernel, /*padding=*/1);
      const at::Tensor transformed = at::empty({maps.positions, maps.weight_stride}),
                       y = at::empty({c.samples, maps.y_height, maps.y_width, c.out}),
                       scratch = at::empty({maps.positions, maps.x_stride + maps.y_stride});
      kernels.transform_weight(maps, in.weight.data_ptr<float>(), false, 0, c.in,
                               transformed.data_ptr());
      maps.weight = transformed.data_ptr();
      maps.y = y.data_ptr();
      kernels.convolve(maps, 0, maps.tiles, scratch.data_ptr<float>());
      EXPECT_LT(RelativeError(y.permute({0, 3, 1, 2}), expected[0]), 1e-6) << Name(c);

      const at::Tensor of_y = in.of_y.permute({0, 2, 3, 1}).contiguous(),
                       sums = at::empty({maps.positions, maps.weight_stride}),
                       gradient = at::empty({c.out, c.in, c.kernel, c.kernel}),
                       more =
                           at::empty({maps.positions, maps.x_pairs_stride + maps.y_pairs_stride});
      maps.y = of_y.data_ptr();
      kernels.weight_gradient_sums(maps, 0, maps.pairs, more.data_ptr<float>(),
                                   sums.data_ptr<float>());
      kernels.weight_gradient(maps, sums.data_ptr<float>(), 0, c.in, gradient.data_ptr<float>());
      EXPECT_LT(RelativeError(gradient, expected[2]), 1e-6) << Name(c);
    }
  }
}

}  // namespace
}  // namespace volalign::winograd_test

#include "core/nn/cpu/normalized_map.h"

#include <ATen/ATen.h>
#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>

#include <algorithm>
#include <string>
#include <vector>

#include "core/nn/cpu/log_probabilities.h"
#include "core/nn/cpu/phase_weight.h"
#include "core/nn/network.h"

namespace volalign::normalized_map_test {
namespace {

/// What one of the functions under test is made from; undefined where it takes no part.
struct Inputs {
  at::Tensor raw, scale, bias, mask, skip;
  std::vector<at::Tensor> Defined() const {
    std::vector<at::Tensor> result;
    for (const at::Tensor& x : {raw, scale, bias, mask, skip}) {
      if (x.defined()) result.push_back(x);
    }
    return result;
  }
  /// Leaves of their own, of which all that need no bfloat16 are of `type`.
  Inputs Copy(at::ScalarType type) const {
    const auto copy = [type](const at::Tensor& x) {
      return x.defined() ? x.detach().to(type).clone().requires_grad_(true) : at::Tensor();
    };
    return {copy(raw), copy(scale), copy(bias), copy(mask), copy(skip)};
  }
};

at::Tensor RunningLike(const at::Tensor& scale, double value) {
  return at::full({scale.size(0)}, value, at::kFloat);
}

/// The single operations, in float64.
std::vector<at::Tensor> Reference(const Inputs& in, Normalization normalization, bool relu,
                                  bool pool) {
  at::Tensor y = in.raw;
  if (normalization == Normalization::kBatch)
    y = at::batch_norm(y, in.scale, in.bias, {}, {}, true, 0.1, kNormEpsilon, false);
  if (normalization == Normalization::kGroup)
    y = at::group_norm(y, NormGroups(y.size(1)), in.scale, in.bias, kNormEpsilon);
  if (normalization == Normalization::kNone) y = y + in.bias.view({1, -1, 1, 1});
  if (relu) y = at::relu(y);
  if (in.mask.defined()) y = y * at::upsample_nearest2d(in.mask, {y.size(2), y.size(3)});
  if (in.skip.defined()) y = at::cat({y, in.skip}, 1);
  if (pool) return {y, at::max_pool2d(y, {2, 2})};
  return {y};
}

std::vector<at::Tensor> Ours(const Inputs& in, const MapParameters& parameters,
                             const MapRecipe& recipe, bool pool) {
  if (pool) {
    const PooledMap map = NormalizedAndPooledMap(in.raw, parameters, recipe);
    return {map.map, map.pooled};
  }
  if (in.skip.defined()) return {NormalizedMapAndSkip(in.raw, parameters, recipe, in.skip)};
  return {NormalizedMap(in.raw, parameters, recipe, in.mask)};
}

void ExpectNear(const at::Tensor& ours, const at::Tensor& expected, double tolerance,
                const std::string& what) {
  ASSERT_TRUE(ours.defined()) << what;
  ASSERT_EQ(ours.sizes(), expected.sizes()) << what;
  const double error = (ours.to(at::kDouble) - expected).norm().item<double>() /
                       (expected.norm().item<double>() + 1e-12);
  EXPECT_TRUE(error <= tolerance) << what << ": " << error;
}

/// Values and gradients of the joined passes are those of the single operations.
TEST(NormalizedMap, EqualsTheSingleOperations) {
  enum class Extra { kNone, kMask, kSkip, kPool };
  for (const Normalization normalization :
       {Normalization::kNone, Normalization::kBatch, Normalization::kGroup}) {
    for (const Extra extra : {Extra::kNone, Extra::kMask, Extra::kSkip, Extra::kPool}) {
      for (const std::int64_t channels : {3, 8, 32}) {
        for (const at::ScalarType type : {at::kFloat, at::kBFloat16}) {
          const std::string what = std::string(ToString(normalization)) + ", extra " +
                                   std::to_string(static_cast<int>(extra)) + ", " +
                                   std::to_string(channels) + " channels, " + at::toString(type);
          const std::int64_t height = 11, width = 70;  // odd, and more than a block
          Inputs in;
          in.raw = (at::randn({3, channels, height, width}) * 2 + 5).to(type).to(at::kDouble);
          if (normalization != Normalization::kNone)
            in.scale = at::rand({channels}, at::kDouble) + 0.5;
          in.bias =
              at::randn({channels}, at::kDouble) - (normalization == Normalization::kNone ? 5 : 0);
          if (extra == Extra::kMask) in.mask = at::rand({3, 1, 4, 9}, at::kDouble);
          if (extra == Extra::kSkip)
            in.skip = at::randn({3, channels, height, width}, at::kDouble).to(type).to(at::kDouble);
          const bool pool = extra == Extra::kPool;
          const Inputs exact = in.Copy(at::kDouble);
          Inputs rounded = in.Copy(at::kFloat);
          at::Tensor raw = rounded.raw.to(type).contiguous(at::MemoryFormat::ChannelsLast);
          Inputs given = rounded;
          given.raw = raw;
          if (in.skip.defined()) given.skip = rounded.skip.to(type);
          MapParameters parameters{rounded.scale, rounded.bias, {}, {}};
          if (normalization == Normalization::kBatch) {
            parameters.running_mean = RunningLike(in.scale, 1);
            parameters.running_var = RunningLike(in.scale, 2);
          }
          const bool relu = channels != 8;
          const auto ours = Ours(given, parameters, {normalization, relu, false, type}, pool);
          const auto expected = Reference(exact, normalization, relu, pool);
          const double tolerance = type == at::kFloat ? 2e-5 : 6e-3;
          at::Tensor ours_sum = at::zeros({}), expected_sum = at::zeros({}, at::kDouble);
          for (std::size_t i = 0; i < expected.size(); ++i) {
            EXPECT_EQ(ours[i].scalar_type(), type);
            ExpectNear(ours[i], expected[i], tolerance, what);
            const at::Tensor weight = at::randn(expected[i].sizes()).to(type).to(at::kDouble);
            expected_sum = expected_sum + (expected[i] * weight).sum();
            ours_sum = ours_sum + (ours[i].to(at::kFloat) * weight.to(at::kFloat)).sum();
          }
          expected_sum.backward();
          ours_sum.backward();
          const auto ours_in = rounded.Defined(), expected_in = exact.Defined();
          for (std::size_t i = 0; i < expected_in.size(); ++i) {
            // Rounded to bfloat16, two pixels of a window can be equal that were not.
            ExpectNear(ours_in[i].grad(), expected_in[i].grad(),
                       i == 0 && type != at::kFloat ? (pool ? 3e-2 : 6e-3) : 1e-4,
                       what + ", gradient " + std::to_string(i));
          }
          if (normalization == Normalization::kBatch) {
            const at::Tensor mean = in.raw.mean({0, 2, 3}),
                             var = in.raw.var(std::vector<std::int64_t>{0, 2, 3}, true);
            ExpectNear(parameters.running_mean, 0.9 + 0.1 * mean, 1e-5, what);
            ExpectNear(parameters.running_var, 1.8 + 0.1 * var, 1e-5, what);
          }
        }
      }
    }
  }
}

/// Sums do not depend on who computes them: a run has the same weights with any run.threads, as far
/// as our own passes are concerned.
TEST(NormalizedMap, IsTheSameOnOneThreadAndTwo) {
  const int threads = at::get_num_threads();
  const at::Tensor values = at::randn({3, 4 * 8, 6, 36}), g = at::randn({3, 16, 10, 70});
  const at::Tensor skip = at::randn({3, 8, 10, 70});
  std::vector<at::Tensor> results;
  for (const int use : {1, 2}) {
    at::set_num_threads(use);
    const at::Tensor raw = values.contiguous(at::MemoryFormat::ChannelsLast).requires_grad_(true);
    const at::Tensor scale = at::ones({8}).requires_grad_(true),
                     bias = at::zeros({8}).requires_grad_(true);
    const at::Tensor map = NormalizedMapAndSkip(
        raw, {scale, bias, RunningLike(scale, 0), RunningLike(scale, 1)},
        {Normalization::kBatch, /*relu=*/true, /*phases=*/true, at::kFloat}, skip);
    (map * g).sum().backward();
    results.push_back(at::cat({map.detach().flatten(), raw.grad().flatten(), scale.grad().flatten(),
                               bias.grad().flatten()}));
  }
  at::set_num_threads(threads);
  EXPECT_TRUE(results[0].equal(results[1]));
}

/// The four phases of a convolution on a small map are the convolution on the enlarged one.
TEST(NormalizedMap, OfPhasesIsTheEnlargedConvolution) {
  for (const Normalization normalization :
       {Normalization::kNone, Normalization::kBatch, Normalization::kGroup}) {
    const at::Tensor x = at::randn({2, 5, 6, 9}), weight = at::randn({8, 5, 3, 3}),
                     skip = at::randn({2, 8, 12, 18});
    Inputs exact, ours;
    exact.scale = at::rand({8}, at::kDouble) + 0.5;
    exact.bias = at::randn({8}, at::kDouble);
    ours = exact.Copy(at::kFloat);
    exact = exact.Copy(at::kDouble);
    const at::Tensor x1 = x.clone().requires_grad_(true), w1 = weight.clone().requires_grad_(true);
    const at::Tensor x2 = x.to(at::kDouble).requires_grad_(true),
                     w2 = weight.to(at::kDouble).requires_grad_(true);
    const at::Tensor raw =
        at::conv2d(x1, PhaseWeight(w1), {}, 1, 1).contiguous(at::MemoryFormat::ChannelsLast);
    MapParameters parameters{
        normalization == Normalization::kNone ? at::Tensor() : ours.scale, ours.bias, {}, {}};
    if (normalization == Normalization::kBatch)
      parameters = {ours.scale, ours.bias, RunningLike(ours.scale, 0), RunningLike(ours.scale, 1)};
    const at::Tensor map =
        NormalizedMapAndSkip(raw, parameters, {normalization, true, true, at::kFloat}, skip);
    exact.raw = at::conv2d(at::upsample_nearest2d(x2, {12, 18}), w2, {}, 1, 1);
    exact.skip = skip.to(at::kDouble);
    const at::Tensor expected = Reference(exact, normalization, true, false)[0];
    ExpectNear(map, expected, 1e-5, ToString(normalization));
    const at::Tensor g = at::randn(expected.sizes());
    (map * g).sum().backward();
    (expected * g.to(at::kDouble)).sum().backward();
    ExpectNear(x1.grad(), x2.grad(), 1e-4, "map");
    ExpectNear(w1.grad(), w2.grad(), 1e-4, "weight");
    ExpectNear(ours.bias.grad(), exact.bias.grad(), 1e-4, "bias");
  }
}

TEST(LogProbabilities, EqualsLogSoftmax) {
  for (const at::ScalarType type : {at::kFloat, at::kBFloat16}) {
    const at::Tensor logits = (at::randn({2, 21, 7, 9}) * 20).to(type).to(at::kFloat);
    const at::Tensor x = logits.clone().requires_grad_(true),
                     y = logits.to(at::kDouble).requires_grad_(true);
    const at::Tensor ours = LogProbabilities(x.to(type)), expected = at::log_softmax(y, 1);
    EXPECT_TRUE((ours - expected).abs().max().item<double>() < 1e-5);
    const at::Tensor g = at::randn(logits.sizes());
    (ours * g).sum().backward();
    (expected * g.to(at::kDouble)).sum().backward();
    ExpectNear(x.grad(), y.grad(), type == at::kFloat ? 1e-5 : 6e-3, at::toString(type));
  }
}

/// A value that is not a number shows in the result: the trainer stops at it.
TEST(NormalizedMap, KeepsNaN) {
  at::Tensor raw = at::zeros({1, 16, 4, 4}).contiguous(at::MemoryFormat::ChannelsLast);
  raw[0][3][2][2] = std::numeric_limits<float>::quiet_NaN();
  const MapParameters parameters{{}, at::zeros({16}), {}, {}};
  for (const at::ScalarType type : {at::kFloat, at::kBFloat16}) {
    const PooledMap map =
        NormalizedAndPooledMap(raw, parameters, {Normalization::kNone, true, false, type});
    EXPECT_EQ(map.map.isnan().sum().item<std::int64_t>(), 1);
    EXPECT_EQ(map.pooled.isnan().sum().item<std::int64_t>(), 1);
    EXPECT_TRUE(LogProbabilities(map.map).isnan().any().item<bool>());
  }
}

/// The network in training gives the same losses and gradients in both layouts, and in bfloat16 it
/// is not much farther from float32: Winograd's algorithm rounds more than a sum of products.
TEST(TrainingForward, EqualsTheSingleOperations) {
  constexpr double kRounding = 1.2e-7;  // of float32
  std::int64_t draws = 0;
  for (const Normalization normalization : AllOf(Normalization())) {
    StructureNetOptions options;
    options.base_channels = 8;  // all but the smallest maps by Winograd's algorithm
    options.num_classes = 6;
    options.residual_blocks = 1;
    options.normalization = normalization;
    options.input = InputEncoding::kDepthMask;
    const at::Tensor input =
        EncodeDepth(at::rand({4, 1, 64, 70}) * 2 + 1, options.input);  // 70: 35, 17, 8
    const at::Tensor labels = at::randint(0, 6, {4, 64, 70}, at::kLong);
    const auto gradient = [&](at::ScalarType type, bool channels_last, at::Tensor* log_probs,
                              double rounding = 0) {
      at::manual_seed(3);
      StructureNet net(options);
      net->SetComputeType(type);
      net->SetChannelsLast(channels_last);
      net->train();
      at::manual_seed(1000 + ++draws);
      *log_probs = net->forward(input * (1 + rounding * at::randn(input.sizes())));
      at::nll_loss_nd(*log_probs, labels).backward();
      std::vector<at::Tensor> all;
      for (const at::Tensor& p : net->parameters()) all.push_back(p.grad().flatten());
      for (const at::Tensor& b : net->buffers()) all.push_back(b.flatten());
      return at::cat(all).to(at::kDouble);
    };
    at::Tensor expected_out, out, plain_out;
    const at::Tensor expected = gradient(at::kFloat, false, &expected_out);
    const at::Tensor joined_gradient = gradient(at::kFloat, true, &out);
    // How far the single operations come from themselves when their input is rounded otherwise.
    double gradient_rounding = 0, out_rounding = 0;
    for (int i = 0; i < 5; ++i) {
      at::Tensor rounded_out;
      const at::Tensor rounded = gradient(at::kFloat, false, &rounded_out, kRounding);
      gradient_rounding = std::max(gradient_rounding, (rounded - expected).norm().item<double>());
      out_rounding = std::max(out_rounding, (rounded_out - expected_out).norm().item<double>());
    }
    EXPECT_LT((joined_gradient - expected).norm().item<double>(), 3 * gradient_rounding)
        << ToString(normalization);
    EXPECT_LT((out - expected_out).norm().item<double>(), 3 * out_rounding)
        << ToString(normalization);
    const double plain =
        (gradient(at::kBFloat16, false, &plain_out) - expected).norm().item<double>();
    const double joined = (gradient(at::kBFloat16, true, &out) - expected).norm().item<double>();
    EXPECT_LT(joined, 4 * plain) << ToString(normalization);  // 2.7 on a processor without bfloat16
    EXPECT_LT((out - expected_out).norm().item<double>(),
              1.5 * (plain_out - expected_out).norm().item<double>())
        << ToString(normalization);
  }
}

}  // namespace
}  // namespace volalign::normalized_map_test

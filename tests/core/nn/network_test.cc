#include "core/nn/network.h"

#include <ATen/ATen.h>
#include <c10/core/GradMode.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "tests/core/base/expect_error.h"

namespace volalign::network_test {
namespace {

StructureNetOptions Small() {
  StructureNetOptions options;
  options.base_channels = 2;
  options.num_classes = 5;
  options.residual_blocks = 1;
  return options;
}

/// As one counts them by hand for the paper's network: 49.3 million, and 3.1 million at a quarter
/// of its width.
TEST(StructureNet, HasAsManyParametersAsThePapers) {
  for (const auto& [channels, attention, expected] :
       std::vector<std::tuple<int, bool, std::int64_t>>{
           {8, false, 3083813}, {8, true, 3083942}, {32, false, 49294421}, {32, true, 49294934}}) {
    StructureNetOptions options;
    options.base_channels = channels;
    options.attention = attention;
    std::int64_t values = 0;
    for (const at::Tensor& p : StructureNet(options)->parameters()) values += p.numel();
    EXPECT_EQ(values, expected);
  }
}

TEST(StructureNet, NamesEveryParameterAfterItsLayer) {
  StructureNetOptions options = Small();
  options.normalization = Normalization::kBatch;
  StructureNet net(options);
  std::set<std::string> names;
  for (const auto& item : net->named_parameters()) names.insert(item.key());
  // 14 + 2 + 12 + 4 + 1 normalised units of 3 tensors; attention and classifier of 2.
  EXPECT_EQ(names.size(), 33u * 3 + 2 * 2);
  for (const char* name :
       {"encoder1_1.weight", "encoder5_3.norm_weight", "residual1_2.norm_bias", "attention.bias",
        "decoder4_3.weight", "merge1.weight", "decoder0_1.weight", "classifier.bias"}) {
    EXPECT_EQ(names.count(name), 1u) << name;
  }
  EXPECT_EQ(names.count("encoder1_1.bias"), 0u);
  EXPECT_EQ(net->named_buffers().size(), 33u * 2);
}

TEST(StructureNet, GivesLogProbabilitiesForOddSizes) {
  c10::NoGradGuard no_grad;
  for (const auto normalization :
       {Normalization::kNone, Normalization::kBatch, Normalization::kGroup}) {
    StructureNetOptions options = Small();
    options.normalization = normalization;
    options.input = InputEncoding::kDepthMask;
    StructureNet net(options);
    const std::vector<std::pair<int, int>> sizes = {
        {16, 16}, {17, 31}, {33, 16}, {45, 80}, {47, 61}};
    for (const auto& [height, width] : sizes) {
      const at::Tensor out =
          net->forward(EncodeDepth(at::rand({2, 1, height, width}) * 4, options.input));
      ASSERT_EQ(out.sizes(), at::IntArrayRef({2, 5, height, width}));
      EXPECT_TRUE(at::isfinite(out).all().item<bool>());
      EXPECT_LT((out.exp().sum(1) - 1).abs().max().item<double>(), 1e-5);
    }
  }
}

TEST(StructureNet, RejectsWrongInput) {
  StructureNet net(Small());
  EXPECT_THROW(net->forward(at::rand({1, 1, 15, 40})), Error);
  EXPECT_THROW(net->forward(at::rand({1, 2, 32, 32})), Error);
  EXPECT_THROW(net->forward(at::rand({1, 1, 32, 32}).to(at::kDouble)), Error);
  StructureNetOptions bad = Small();
  bad.base_channels = 0;
  EXPECT_THROW(StructureNet{bad}, ConfigError);
}

TEST(StructureNet, ClosedAttentionLeavesOnlyTheClassifierBias) {
  c10::NoGradGuard no_grad;
  StructureNetOptions options = Small();
  options.background_bias = 4;
  StructureNet net(options);
  const at::Tensor x = at::rand({1, 1, 32, 48});
  auto parameters = net->named_parameters();
  parameters["classifier.bias"].select(0, 2).fill_(1.5);
  const at::Tensor expected = at::log_softmax(at::tensor({4.0f, 0.0f, 1.5f, 0.0f, 0.0f}), 0);
  const at::Tensor open = net->forward(x);
  parameters["attention.weight"].zero_();
  parameters["attention.bias"].fill_(-200);  // sigmoid = 0: every decoder level is multiplied by 0
  const at::Tensor closed = net->forward(x);
  const at::Tensor everywhere = expected.view({1, 5, 1, 1}).expand_as(closed);
  EXPECT_TRUE(at::allclose(closed, everywhere, 0, 1e-6));
  EXPECT_FALSE(at::allclose(open, everywhere, 0, 1e-2));
}

TEST(StructureNet, WithoutAttentionEqualsAttentionOfOne) {
  c10::NoGradGuard no_grad;
  StructureNetOptions options = Small();
  StructureNet with(options);
  options.attention = false;
  StructureNet without(options);
  auto source = with->named_parameters();
  for (auto& item : without->named_parameters()) item.value().copy_(source[item.key()]);
  source["attention.weight"].zero_();
  source["attention.bias"].fill_(200);
  const at::Tensor x = at::rand({1, 1, 24, 40});
  EXPECT_TRUE(at::allclose(with->forward(x), without->forward(x), 1e-5, 1e-6));
}

TEST(StructureNet, GivesItsAttentionBesideTheProbabilities) {
  c10::NoGradGuard no_grad;
  StructureNetOptions options = Small();
  StructureNet net(options);
  const at::Tensor x = at::rand({2, 1, 45, 80});
  const NetworkOutput output = net->ForwardWithAttention(x);
  EXPECT_TRUE(output.log_probabilities.equal(net->forward(x)));
  ASSERT_EQ(output.attention.sizes(), at::IntArrayRef({2, 1, 2, 5}));
  EXPECT_GT(output.attention.min().item<double>(), 0);
  EXPECT_LT(output.attention.max().item<double>(), 1);
  // The map is the one that the decoder is multiplied by: with zero weights, the bias's sigmoid.
  auto parameters = net->named_parameters();
  parameters["attention.weight"].zero_();
  parameters["attention.bias"].fill_(1.5);
  const double expected = 1 / (1 + std::exp(-1.5));
  EXPECT_LT((net->ForwardWithAttention(x).attention - expected).abs().max().item<double>(), 1e-6);
  options.attention = false;
  EXPECT_FALSE(StructureNet(options)->ForwardWithAttention(x).attention.defined());
}

TEST(StructureNet, InitialisesByXavierWithZeroBiases) {
  StructureNetOptions options;
  options.base_channels = 8;
  StructureNet net(options);
  auto parameters = net->named_parameters();
  const at::Tensor w = parameters["encoder4_2.weight"];  // 128 -> 128, 3x3: bound sqrt(6 / 2304)
  const double bound = std::sqrt(6.0 / (2 * 128 * 9));
  EXPECT_LE(w.abs().max().item<double>(), bound);
  EXPECT_NEAR(w.std().item<double>(), bound / std::sqrt(3.0), 0.01 * bound);
  EXPECT_EQ(parameters["encoder4_2.bias"].abs().max().item<double>(), 0);
}

TEST(StructureNet, Bfloat16KeepsDepthAndFirstConvolutionInFloat32) {
  c10::NoGradGuard no_grad;
  StructureNetOptions options = Small();
  StructureNet net(options);
  auto parameters = net->named_parameters();
  parameters["encoder1_1.weight"].zero_();
  parameters["encoder1_1.weight"].select(2, 3).select(2, 3).fill_(1000);
  parameters["encoder1_1.bias"].fill_(-2999);
  const at::Tensor near = at::full({1, 1, 16, 16}, 3.0f);
  const at::Tensor far = at::full({1, 1, 16, 16}, 3.004f);  // the same number in bfloat16
  ASSERT_TRUE(near.to(at::kBFloat16).equal(far.to(at::kBFloat16)));
  net->SetComputeType(at::kBFloat16);
  const at::Tensor a = net->forward(near), b = net->forward(far);
  EXPECT_EQ(a.scalar_type(), at::kFloat);
  EXPECT_GT((a - b).abs().max().item<double>(), 0.01);
  EXPECT_LT((a.exp().sum(1) - 1).abs().max().item<double>(), 1e-5);
  net->SetComputeType(at::kFloat);
  EXPECT_LT((net->forward(near) - a).abs().max().item<double>(), 0.2);
  EXPECT_THROW(net->SetComputeType(at::kHalf), Error);
}

/// Between 0.998 and 1 bfloat16 has no number: a mask that is rounded to 1 would never learn.
TEST(StructureNet, AnOpenMaskKeepsItsGradientInBfloat16) {
  for (const bool channels_last : {false, true}) {
    SCOPED_TRACE(channels_last);
    StructureNetOptions options;
    options.base_channels = 4;
    StructureNet net(options);
    net->SetComputeType(at::kBFloat16);
    net->SetChannelsLast(channels_last);
    at::Tensor bias = net->named_parameters()["attention.bias"];
    {
      c10::NoGradGuard no_grad;
      bias.fill_(8);
      const at::Tensor mask = net->ForwardWithAttention(at::rand({1, 1, 32, 32})).attention;
      EXPECT_NEAR(mask.min().item<double>(), 1 / (1 + std::exp(-8.0)), 1e-5);
    }
    net->train();
    net->forward(at::rand({2, 1, 32, 32})).select(1, 0).sum().backward();
    EXPECT_NE(bias.grad().item<double>(), 0);
  }
}

/// The network in training gives the same losses and gradients in both layouts, and in bfloat16 it
/// is not much farther from float32: Winograd's algorithm rounds more than a sum of products.
TEST(StructureNet, TrainsAlikeInBothLayouts) {
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
    const at::Tensor fast_gradient = gradient(at::kFloat, true, &out);
    // How far the direct convolutions come from themselves if their input is rounded otherwise.
    double gradient_rounding = 0, out_rounding = 0;
    for (int i = 0; i < 5; ++i) {
      at::Tensor rounded_out;
      const at::Tensor rounded = gradient(at::kFloat, false, &rounded_out, kRounding);
      gradient_rounding = std::max(gradient_rounding, (rounded - expected).norm().item<double>());
      out_rounding = std::max(out_rounding, (rounded_out - expected_out).norm().item<double>());
    }
    EXPECT_LT((fast_gradient - expected).norm().item<double>(), 3 * gradient_rounding)
        << ToString(normalization);
    EXPECT_LT((out - expected_out).norm().item<double>(), 6 * out_rounding)
        << ToString(normalization);
    const double plain =
        (gradient(at::kBFloat16, false, &plain_out) - expected).norm().item<double>();
    const double fast = (gradient(at::kBFloat16, true, &out) - expected).norm().item<double>();
    EXPECT_LT(fast, 4 * plain) << ToString(normalization);  // 2.7 on a processor without bfloat16
    EXPECT_LT((out - expected_out).norm().item<double>(),
              1.5 * (plain_out - expected_out).norm().item<double>())
        << ToString(normalization);
  }
}

TEST(EncodeDepth, DepthMaskCentresClampsAndMasks) {
  const at::Tensor depth = at::tensor({0.0f, 1.5f, 2.0f, 16.0f}).view({1, 1, 2, 2});
  EXPECT_TRUE(EncodeDepth(depth, InputEncoding::kDepth).equal(depth));
  const at::Tensor expected =
      at::tensor({0.0f, -0.5f, 0.0f, 4.0f, 0.0f, 1.0f, 1.0f, 1.0f}).view({1, 2, 2, 2});
  EXPECT_TRUE(EncodeDepth(depth, InputEncoding::kDepthMask).equal(expected));
  EXPECT_THROW(EncodeDepth(depth.squeeze(0), InputEncoding::kDepth), Error);
}

/// Every class alike at every pixel.
class EvenNet : public StructureNetImpl {
 public:
  using StructureNetImpl::StructureNetImpl;
  NetworkOutput ForwardWithAttention(const at::Tensor& input) override {
    RequireInput(input);
    const double log_probability = -std::log(options().num_classes);
    return {at::full({input.size(0), options().num_classes, input.size(2), input.size(3)},
                     log_probability),
            at::Tensor()};
  }
};

TEST(RegisterNetwork, MakesAKindOfNetwork) {
  StructureNetOptions options = Small();
  options.kind = "even";
  ExpectError<ConfigError>([&] { StructureNet{options}; }, {"model.kind = 'even'"});
  RegisterNetwork("even",
                  [](const StructureNetOptions& o) { return std::make_shared<EvenNet>(o); });
  StructureNet net(options);
  EXPECT_EQ(NetworkKinds(), (std::vector<std::string>{"paper", "even"}));
  EXPECT_NEAR(net->forward(at::rand({1, 1, 20, 30})).exp().sum().item<double>(), 20 * 30, 1e-3);
  EXPECT_THROW(net->forward(at::rand({1, 1, 8, 30})), Error);
  EXPECT_THROW(RegisterNetwork("even", nullptr), Error);
  EXPECT_THROW(RegisterNetwork("paper", nullptr), Error);
  EXPECT_FALSE(options == Small());
}

}  // namespace
}  // namespace volalign::network_test

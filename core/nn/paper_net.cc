#include "core/nn/paper_net.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/batch_norm.h>
#include <ATen/ops/cat.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/group_norm.h>
#include <ATen/ops/log_softmax.h>
#include <ATen/ops/max_pool2d.h>
#include <ATen/ops/ones.h>
#include <ATen/ops/relu.h>
#include <ATen/ops/sigmoid.h>
#include <ATen/ops/upsample_nearest2d.h>
#include <ATen/ops/zeros.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>
#include <torch/csrc/autograd/generated/variable_factories.h>

#include <cmath>

#include "core/base/error.h"
#include "core/nn/cpu/convolution.h"
#include "core/nn/training_forward.h"

namespace volalign {
namespace {

/// A weight [out,in,k,k] with Xavier's uniform initialisation (Glorot and Bengio 2010):
/// U(-a, a), a = sqrt(6 / (fan_in + fan_out)).
at::Tensor XavierWeight(int in, int out, int kernel) {
  const double bound = std::sqrt(6.0 / ((in + out) * kernel * kernel));
  at::Tensor weight = torch::empty({out, in, kernel, kernel});
  c10::NoGradGuard no_grad;
  weight.uniform_(-bound, bound);
  return weight;
}

at::Tensor UpsampleTo(const at::Tensor& x, const at::Tensor& like) {
  if (x.size(2) == like.size(2) && x.size(3) == like.size(3)) return x;
  return at::upsample_nearest2d(x, {like.size(2), like.size(3)});
}

}  // namespace

ConvUnitImpl::ConvUnitImpl(int in, int out, int kernel, Normalization normalization)
    : normalization_(normalization) {
  weight = register_parameter("weight", XavierWeight(in, out, kernel));
  if (normalization == Normalization::kNone) {
    bias = register_parameter("bias", torch::zeros({out}));
    return;
  }
  norm_weight = register_parameter("norm_weight", torch::ones({out}));
  norm_bias = register_parameter("norm_bias", torch::zeros({out}));
  if (normalization == Normalization::kBatch) {
    running_mean = register_buffer("running_mean", torch::zeros({out}));
    running_var = register_buffer("running_var", torch::ones({out}));
  }
}

at::Tensor ConvUnitImpl::forward(const at::Tensor& x, at::ScalarType dtype) {
  const at::Tensor y = Convolve(x, weight, dtype, weight.size(2) / 2, bias);
  switch (normalization_) {
    case Normalization::kNone:
      return y;
    case Normalization::kBatch:
      return at::batch_norm(y, norm_weight, norm_bias, running_mean, running_var, is_training(),
                            kNormMomentum, kNormEpsilon, /*cudnn_enabled=*/true);
    case Normalization::kGroup: {
      return at::group_norm(y.to(at::kFloat), NormGroups(weight.size(0)), norm_weight, norm_bias,
                            kNormEpsilon)
          .to(dtype);
    }
  }
  throw Error("invalid Normalization");
}

PaperNetImpl::PaperNetImpl(const StructureNetOptions& options) : StructureNetImpl(options) {
  const int c = options.base_channels;
  struct Conv {
    int kernel, factor;  // output channels are factor * c
  };
  const std::vector<std::vector<Conv>> groups = {{{7, 1}, {5, 2}},
                                                 {{3, 4}, {3, 4}, {3, 4}},
                                                 {{3, 8}, {3, 8}, {3, 8}},
                                                 {{3, 16}, {3, 16}, {3, 16}},
                                                 {{3, 16}, {3, 16}, {3, 16}}};
  int channels = EncodedChannels(options.input);
  std::vector<int> skip_channels;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    layers_.encoder.emplace_back();
    for (std::size_t i = 0; i < groups[g].size(); ++i) {
      const Conv& conv = groups[g][i];
      layers_.encoder.back().push_back(
          Add(fmt::format("encoder{}_{}", g + 1, i + 1), channels, conv.factor * c, conv.kernel));
      channels = conv.factor * c;
    }
    skip_channels.push_back(channels);
  }
  for (int i = 1; i <= options.residual_blocks; ++i) {
    layers_.bottleneck.push_back({Add(fmt::format("residual{}_1", i), channels, channels, 3),
                                  Add(fmt::format("residual{}_2", i), channels, channels, 3)});
  }
  if (options.attention) {
    layers_.attention =
        register_module("attention", ConvUnit(channels, 1, 1, Normalization::kNone));
  }
  for (int level = 4; level >= 1; --level) {
    const int skip = skip_channels[static_cast<std::size_t>(level - 1)];
    PaperNetLayers::DecoderLevel d;
    d.first = Add(fmt::format("decoder{}_1", level), channels, channels, 3);
    d.second = Add(fmt::format("decoder{}_2", level), channels, channels, 3);
    d.up = Add(fmt::format("decoder{}_3", level), channels, skip, 3);
    d.merge = Add(fmt::format("merge{}", level), 2 * skip, skip, 1);
    layers_.decoder.push_back(d);
    channels = skip;
  }
  layers_.last = Add("decoder0_1", channels, c, 3);
  layers_.classifier =
      register_module("classifier", ConvUnit(c, options.num_classes, 1, Normalization::kNone));
  c10::NoGradGuard no_grad;
  layers_.classifier->bias.select(0, 0).fill_(options.background_bias);
}

ConvUnit PaperNetImpl::Add(const std::string& name, int in, int out, int kernel) {
  return register_module(name, ConvUnit(in, out, kernel, options().normalization));
}

at::Tensor PaperNetImpl::Relu(ConvUnit& unit, const at::Tensor& x) {
  return unit->forward(x, compute_type()).relu_();
}

at::Tensor PaperNetImpl::forward(const at::Tensor& input) {
  if (channels_last() && is_training() && c10::GradMode::is_enabled() && input.is_cpu()) {
    RequireInput(input);
    return TrainingForward(layers_, options().normalization, compute_type(), input);
  }
  return ForwardWithAttention(input).log_probabilities;
}

NetworkOutput PaperNetImpl::ForwardWithAttention(const at::Tensor& input) {
  RequireInput(input);
  std::vector<at::Tensor> skips;
  at::Tensor x =
      layers_.encoder[0][0]->forward(input, at::kFloat).relu_().to(compute_type());  // [B,c,H,W]
  for (std::size_t g = 0; g < layers_.encoder.size(); ++g) {
    if (g > 0) {
      skips.push_back(x);
      x = at::max_pool2d(x, {2, 2});
    }
    for (std::size_t i = (g == 0 ? 1 : 0); i < layers_.encoder[g].size(); ++i)
      x = Relu(layers_.encoder[g][i], x);
  }
  for (PaperNetLayers::ResidualBlock& block : layers_.bottleneck) {
    x = x + block.second->forward(Relu(block.first, at::relu(x)), compute_type());
  }
  at::Tensor mask;  // [B,1,H/16,W/16]
  if (options().attention) {
    mask = at::sigmoid(layers_.attention->forward(x, compute_type()));
    x = x * mask;
  }
  for (PaperNetLayers::DecoderLevel& level : layers_.decoder) {
    const at::Tensor skip = skips.back();
    skips.pop_back();
    x = Relu(level.second, Relu(level.first, x));
    x = Relu(level.up, UpsampleTo(x, skip));
    x = Relu(level.merge, at::cat({x, skip}, 1));
    if (options().attention) x = x * UpsampleTo(mask, x);
  }
  const at::Tensor logits =
      layers_.classifier->forward(Relu(layers_.last, x), compute_type());  // [B,K,H,W]
  return {at::log_softmax(logits.to(at::kFloat), 1),
          mask.defined() ? mask.to(at::kFloat) : at::Tensor()};
}

}  // namespace volalign

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
#include <map>
#include <string>

#include "core/base/error.h"
#include "core/model/paper_units.h"
#include "core/nn/cpu/convolution.h"
#include "core/nn/cpu/winograd.h"

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

bool IsTwice(const at::Tensor& like, const at::Tensor& x) {
  return like.size(2) == 2 * x.size(2) && like.size(3) == 2 * x.size(3);
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

bool ConvUnitImpl::IsTrained() const { return is_training() && c10::GradMode::is_enabled(); }

at::Tensor ConvUnitImpl::forward(const at::Tensor& x, at::ScalarType dtype) {
  if (!IsTrained() || !WinogradSuits(x, weight, dtype))
    return Normalize(Convolve(x, weight, dtype, weight.size(2) / 2, bias), dtype);
  at::Tensor y = WinogradConvolve(x, weight, dtype);
  if (bias.defined()) y.add_(bias.to(dtype).view({1, -1, 1, 1}));
  return Normalize(y, dtype);
}

at::Tensor ConvUnitImpl::ForwardEnlarged(const at::Tensor& x, const at::Tensor& like,
                                         at::ScalarType dtype) {
  const bool channels_last = x.is_cpu() && x.is_contiguous(at::MemoryFormat::ChannelsLast);
  if (!IsTrained() || !channels_last || !IsTwice(like, x))
    return forward(UpsampleTo(x, like), dtype);
  const at::Tensor phase_weight = PhaseWeight(weight);
  at::Tensor y = FromPhases(WinogradSuits(x, phase_weight, dtype)
                                ? WinogradConvolve(x, phase_weight, dtype)
                                : Convolve(x, phase_weight, dtype, /*padding=*/1));
  if (bias.defined()) y = y + bias.to(dtype).view({1, -1, 1, 1});
  return Normalize(y, dtype);
}

at::Tensor ConvUnitImpl::Normalize(const at::Tensor& y, at::ScalarType dtype) {
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

at::Tensor AttentionMask(const ConvUnitImpl& unit, const at::Tensor& x) {
  return at::sigmoid(Convolve(x.to(at::kFloat), unit.weight, at::kFloat, /*padding=*/0, unit.bias));
}

PaperNetImpl::PaperNetImpl(const StructureNetOptions& options) : StructureNetImpl(options) {
  std::map<std::string, ConvUnit> units;
  for (const PaperUnit& unit : PaperUnits(options)) {
    units.emplace(unit.name, register_module(unit.name, ConvUnit(unit.in, unit.out, unit.kernel,
                                                                 unit.normalization)));
  }
  for (std::size_t g = 1; g <= EncoderGroups().size(); ++g) {
    layers_.encoder.emplace_back();
    for (int i = 1; i <= EncoderGroups()[g - 1]; ++i)
      layers_.encoder.back().push_back(units.at(fmt::format("encoder{}_{}", g, i)));
  }
  for (int i = 1; i <= options.residual_blocks; ++i) {
    layers_.bottleneck.push_back(
        {units.at(fmt::format("residual{}_1", i)), units.at(fmt::format("residual{}_2", i))});
  }
  if (options.attention) layers_.attention = units.at("attention");
  for (int level = 4; level >= 1; --level) {
    layers_.decoder.push_back(
        {units.at(fmt::format("decoder{}_1", level)), units.at(fmt::format("decoder{}_2", level)),
         units.at(fmt::format("decoder{}_3", level)), units.at(fmt::format("merge{}", level))});
  }
  layers_.last = units.at("decoder0_1");
  layers_.classifier = units.at("classifier");
  c10::NoGradGuard no_grad;
  layers_.classifier->bias.select(0, 0).fill_(options.background_bias);
}

at::Tensor PaperNetImpl::Relu(ConvUnit& unit, const at::Tensor& x) {
  return unit->forward(x, compute_type()).relu_();
}

NetworkOutput PaperNetImpl::ForwardWithAttention(const at::Tensor& input) {
  RequireInput(input);
  std::vector<at::Tensor> skips;
  const at::Tensor ordered = channels_last() && is_training() ? ChannelsLast(input) : input;
  at::Tensor x =
      layers_.encoder[0][0]->forward(ordered, at::kFloat).relu_().to(compute_type());  // [B,c,H,W]
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
    mask = AttentionMask(*layers_.attention, x);
    x = x * mask.to(compute_type());
  }
  for (PaperNetLayers::DecoderLevel& level : layers_.decoder) {
    const at::Tensor skip = skips.back();
    skips.pop_back();
    x = Relu(level.second, Relu(level.first, x));
    x = level.up->ForwardEnlarged(x, skip, compute_type()).relu_();
    x = Relu(level.merge, at::cat({x, skip}, 1));
    if (options().attention) x = x * UpsampleTo(mask, x).to(compute_type());
  }
  const at::Tensor logits =
      layers_.classifier->forward(Relu(layers_.last, x), compute_type());  // [B,K,H,W]
  return {at::log_softmax(logits.to(at::kFloat), 1), mask};
}

}  // namespace volalign

#include "core/network.h"

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
#include <numeric>
#include <sstream>

#include "core/convolution.h"
#include "core/error.h"
#include "core/training_forward.h"

namespace volalign {
namespace {

constexpr double kBatchNormMomentum = 0.1;
constexpr std::int64_t kMaxGroups = 8;

std::string ShapeText(const at::Tensor& x) {
  return fmt::format("[{}]", fmt::join(x.sizes().begin(), x.sizes().end(), ","));
}

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

const char* ToString(Normalization normalization) {
  switch (normalization) {
    case Normalization::kNone:
      return "none";
    case Normalization::kBatch:
      return "batch";
    case Normalization::kGroup:
      return "group";
  }
  throw Error("invalid Normalization");
}

const char* ToString(InputEncoding input) {
  switch (input) {
    case InputEncoding::kDepth:
      return "depth";
    case InputEncoding::kDepthMask:
      return "depth_mask";
  }
  throw Error("invalid InputEncoding");
}

Normalization ParseNormalization(const std::string& word) {
  for (Normalization n : {Normalization::kNone, Normalization::kBatch, Normalization::kGroup}) {
    if (word == ToString(n)) return n;
  }
  throw ConfigError(fmt::format("normalization = '{}' is unknown: use none, batch or group", word));
}

InputEncoding ParseInputEncoding(const std::string& word) {
  for (InputEncoding i : {InputEncoding::kDepth, InputEncoding::kDepthMask}) {
    if (word == ToString(i)) return i;
  }
  throw ConfigError(fmt::format("input = '{}' is unknown: use depth or depth_mask", word));
}

int EncodedChannels(InputEncoding input) { return input == InputEncoding::kDepth ? 1 : 2; }

at::Tensor EncodeDepth(const at::Tensor& depth, InputEncoding input) {
  if (depth.dim() != 4 || depth.size(1) != 1 || depth.scalar_type() != at::kFloat) {
    throw Error(fmt::format("EncodeDepth needs depth [B,1,H,W] of float32, not {} of {}",
                            ShapeText(depth), at::toString(depth.scalar_type())));
  }
  if (input == InputEncoding::kDepth) return depth;
  const at::Tensor mask = (depth > 0).to(at::kFloat);
  return at::cat({(depth.clamp_max(kDepthClamp) - kDepthCentre) * mask, mask}, 1);
}

void StructureNetOptions::Validate() const {
  const auto require = [](bool holds, const char* name, double value, const char* constraint) {
    if (!holds) {
      throw ConfigError(fmt::format("model.{} = {} violates {}", name, value, constraint));
    }
  };
  require(base_channels >= 1, "base_channels", base_channels, "base_channels >= 1");
  require(num_classes >= 2, "num_classes", num_classes, "num_classes >= 2");
  require(residual_blocks >= 0, "residual_blocks", residual_blocks, "residual_blocks >= 0");
  require(std::isfinite(background_bias), "background_bias", background_bias, "a finite number");
}

bool operator==(const StructureNetOptions& a, const StructureNetOptions& b) {
  return a.base_channels == b.base_channels && a.num_classes == b.num_classes &&
         a.attention == b.attention && a.normalization == b.normalization && a.input == b.input &&
         a.residual_blocks == b.residual_blocks && a.background_bias == b.background_bias;
}

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
                            kBatchNormMomentum, kNormEpsilon, /*cudnn_enabled=*/true);
    case Normalization::kGroup: {
      return at::group_norm(y.to(at::kFloat), NormGroups(weight.size(0)), norm_weight, norm_bias,
                            kNormEpsilon)
          .to(dtype);
    }
  }
  throw Error("invalid Normalization");
}

StructureNetImpl::StructureNetImpl(const StructureNetOptions& options) : options_(options) {
  options.Validate();
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
    StructureNetLayers::DecoderLevel d;
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

ConvUnit StructureNetImpl::Add(const std::string& name, int in, int out, int kernel) {
  return register_module(name, ConvUnit(in, out, kernel, options_.normalization));
}

at::Tensor StructureNetImpl::Relu(ConvUnit& unit, const at::Tensor& x) {
  return unit->forward(x, dtype_).relu_();
}

void StructureNetImpl::SetComputeType(at::ScalarType dtype) {
  if (dtype != at::kFloat && dtype != at::kBFloat16) {
    throw Error(fmt::format("compute type {} is neither Float nor BFloat16", at::toString(dtype)));
  }
  dtype_ = dtype;
}

void StructureNetImpl::RequireInput(const at::Tensor& input) const {
  const int channels = EncodedChannels(options_.input);
  if (input.dim() != 4 || input.size(1) != channels || input.size(2) < 16 || input.size(3) < 16 ||
      input.scalar_type() != at::kFloat) {
    throw Error(
        fmt::format("StructureNet needs input [B,{},H,W] of float32 with H, W >= 16 (EncodeDepth), "
                    "not {} of {}",
                    channels, ShapeText(input), at::toString(input.scalar_type())));
  }
}

at::Tensor StructureNetImpl::forward(const at::Tensor& input) {
  if (channels_last_ && is_training() && c10::GradMode::is_enabled() && input.is_cpu()) {
    RequireInput(input);
    return TrainingForward(layers_, options_.normalization, dtype_, input);
  }
  return ForwardWithAttention(input).log_probabilities;
}

NetworkOutput StructureNetImpl::ForwardWithAttention(const at::Tensor& input) {
  RequireInput(input);
  std::vector<at::Tensor> skips;
  at::Tensor x = layers_.encoder[0][0]->forward(input, at::kFloat).relu_().to(dtype_);  // [B,c,H,W]
  for (std::size_t g = 0; g < layers_.encoder.size(); ++g) {
    if (g > 0) {
      skips.push_back(x);
      x = at::max_pool2d(x, {2, 2});
    }
    for (std::size_t i = (g == 0 ? 1 : 0); i < layers_.encoder[g].size(); ++i)
      x = Relu(layers_.encoder[g][i], x);
  }
  for (StructureNetLayers::ResidualBlock& block : layers_.bottleneck) {
    x = x + block.second->forward(Relu(block.first, at::relu(x)), dtype_);
  }
  at::Tensor mask;  // [B,1,H/16,W/16]
  if (options_.attention) {
    mask = at::sigmoid(layers_.attention->forward(x, dtype_));
    x = x * mask;
  }
  for (StructureNetLayers::DecoderLevel& level : layers_.decoder) {
    const at::Tensor skip = skips.back();
    skips.pop_back();
    x = Relu(level.second, Relu(level.first, x));
    x = Relu(level.up, UpsampleTo(x, skip));
    x = Relu(level.merge, at::cat({x, skip}, 1));
    if (options_.attention) x = x * UpsampleTo(mask, x);
  }
  const at::Tensor logits =
      layers_.classifier->forward(Relu(layers_.last, x), dtype_);  // [B,K,H,W]
  return {at::log_softmax(logits.to(at::kFloat), 1),
          mask.defined() ? mask.to(at::kFloat) : at::Tensor()};
}

std::string StructureNetImpl::prettyString() const {
  std::ostringstream out;
  pretty_print(out);
  return out.str();
}

void StructureNetImpl::pretty_print(std::ostream& stream) const {
  stream << fmt::format(
      "StructureNet(base_channels {}, classes {}, attention {}, normalization {}, "
      "input {}, residual_blocks {})\n",
      options_.base_channels, options_.num_classes, options_.attention ? "yes" : "no",
      ToString(options_.normalization), ToString(options_.input), options_.residual_blocks);
  for (const auto& item : named_children()) {
    const at::Tensor weight = item.value()->named_parameters(false)["weight"];
    stream << fmt::format("  {:<12} {}x{} {} -> {}\n", item.key(), weight.size(2), weight.size(3),
                          weight.size(1), weight.size(0));
  }
  stream << fmt::format("  parameters   {}", CountParameters(*this));
}

std::int64_t NormGroups(std::int64_t channels) { return std::gcd(channels, kMaxGroups); }

std::int64_t CountParameters(const torch::nn::Module& module) {
  std::int64_t count = 0;
  for (const at::Tensor& p : module.parameters()) count += p.numel();
  return count;
}

}  // namespace volalign

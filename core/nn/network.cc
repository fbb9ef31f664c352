#include "core/nn/network.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/cat.h>
#include <fmt/format.h>

#include <map>
#include <utility>

#include "core/base/error.h"

namespace volalign {
namespace {

std::string ShapeText(const at::Tensor& x) {
  return fmt::format("[{}]", fmt::join(x.sizes().begin(), x.sizes().end(), ","));
}

std::map<std::string, NetworkFactory>& Registered() {
  static std::map<std::string, NetworkFactory> registered;
  return registered;
}

std::shared_ptr<StructureNetImpl> MakeNetwork(const StructureNetOptions& options) {
  if (options.kind == "paper") return NewPaperNet(options);
  const auto found = Registered().find(options.kind);
  if (found == Registered().end()) {
    throw ConfigError(
        fmt::format("model.kind = '{}' is unknown: use {}, or a program that registers it",
                    options.kind, fmt::join(NetworkKinds(), ", ")));
  }
  return found->second(options);
}

}  // namespace

at::Tensor EncodeDepth(const at::Tensor& depth, InputEncoding input) {
  if (depth.dim() != 4 || depth.size(1) != 1 || depth.scalar_type() != at::kFloat) {
    throw Error(fmt::format("EncodeDepth needs depth [B,1,H,W] of float32, not {} of {}",
                            ShapeText(depth), at::toString(depth.scalar_type())));
  }
  if (input == InputEncoding::kDepth) return depth;
  const at::Tensor mask = (depth > 0).to(at::kFloat);
  return at::cat({(depth.clamp_max(kDepthClamp) - kDepthCentre) * mask, mask}, 1);
}

void RegisterNetwork(const std::string& kind, NetworkFactory factory) {
  if (kind == "paper" || !Registered().emplace(kind, std::move(factory)).second)
    throw Error(fmt::format("there is a network '{}' already", kind));
}

std::vector<std::string> NetworkKinds() {
  std::vector<std::string> kinds{"paper"};
  for (const auto& [kind, factory] : Registered()) kinds.push_back(kind);
  return kinds;
}

StructureNet::StructureNet(const StructureNetOptions& options)
    : ModuleHolder<StructureNetImpl>(MakeNetwork(options)) {}

StructureNetImpl::StructureNetImpl(const StructureNetOptions& options) : options_(options) {
  options.Validate();
}

at::Tensor StructureNetImpl::forward(const at::Tensor& input) {
  return ForwardWithAttention(input).log_probabilities;
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

}  // namespace volalign

#include "train/optimizer.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/zeros.h>
#include <ATen/ops/zeros_like.h>
#include <c10/core/GradMode.h>

#include <algorithm>
#include <cmath>

namespace volalign {
namespace {

constexpr double kAdamEpsilon = 1e-8;
constexpr double kPi = 3.14159265358979323846;

}  // namespace

FlatModule::FlatModule(torch::nn::Module& module) {
  c10::NoGradGuard no_grad;
  std::vector<std::pair<std::string, at::Tensor>> ordered;
  for (const auto& item : module.named_parameters()) ordered.emplace_back(item.key(), item.value());
  std::stable_partition(ordered.begin(), ordered.end(),
                        [](const auto& item) { return item.second.dim() > 1; });
  std::int64_t total = 0;
  for (const auto& [name, p] : ordered) {
    slots_.push_back({name, total, p.sizes().vec()});
    total += p.numel();
    if (p.dim() > 1) num_weights_ = total;
  }
  const at::TensorOptions options =
      at::TensorOptions(at::kFloat).device(ordered.at(0).second.device());
  parameters_ = at::empty({total}, options);
  gradients_ = at::zeros({total}, options);
  for (std::size_t i = 0; i < ordered.size(); ++i) {
    at::Tensor& p = ordered[i].second;
    const at::Tensor view = parameters_.narrow(0, slots_[i].offset, p.numel()).view(p.sizes());
    view.copy_(p);
    p.set_data(view);
    p.mutable_grad() = gradients_.narrow(0, slots_[i].offset, p.numel()).view(p.sizes());
  }

  std::vector<at::Tensor> buffers = module.buffers();
  std::int64_t values = 0;
  for (const at::Tensor& b : buffers) values += b.numel();
  buffers_ = at::empty({values}, options);
  std::int64_t offset = 0;
  for (at::Tensor& b : buffers) {
    const at::Tensor view = buffers_.narrow(0, offset, b.numel()).view(b.sizes());
    view.copy_(b);
    b.set_data(view);
    offset += b.numel();
  }
}

void FlatModule::AddViews(const at::Tensor& flat, const std::string& prefix,
                          std::map<std::string, at::Tensor>* tensors) const {
  for (const Slot& slot : slots_) {
    std::int64_t count = 1;
    for (std::int64_t size : slot.sizes) count *= size;
    tensors->emplace(prefix + slot.name, flat.narrow(0, slot.offset, count).view(slot.sizes));
  }
}

double LearningRate(const OptimConfig& config, std::int64_t samples, std::int64_t total) {
  if (samples < config.warmup_samples) {
    return config.lr * static_cast<double>(samples + 1) /
           static_cast<double>(config.warmup_samples + 1);
  }
  if (config.schedule == "constant") return config.lr;
  const double t = static_cast<double>(samples - config.warmup_samples) /
                   static_cast<double>(std::max<std::int64_t>(1, total - config.warmup_samples));
  return config.lr * 0.5 * (1 + std::cos(kPi * std::min(1.0, t)));
}

Adam::Adam(const OptimConfig& config, FlatModule* module)
    : config_(config),
      module_(module),
      mean_(at::zeros_like(module->parameters())),
      square_(at::zeros_like(module->parameters())) {}

at::Tensor Adam::GradientNorm() const { return module_->gradients().norm(); }

void Adam::Step(double lr, const at::Tensor& gradient_norm) {
  c10::NoGradGuard no_grad;
  at::Tensor& p = module_->parameters();
  at::Tensor& g = module_->gradients();
  if (config_.clip_norm > 0) g.mul_((config_.clip_norm / (gradient_norm + 1e-6)).clamp_max(1.0));
  ++steps_;
  mean_.lerp_(g, 1 - config_.beta1);
  square_.mul_(config_.beta2).addcmul_(g, g, 1 - config_.beta2);
  const double correction1 = 1 - std::pow(config_.beta1, static_cast<double>(steps_));
  const double correction2 = 1 - std::pow(config_.beta2, static_cast<double>(steps_));
  if (config_.weight_decay > 0) {
    p.narrow(0, 0, module_->num_weights()).mul_(1 - lr * config_.weight_decay);
  }
  const at::Tensor denominator = square_.sqrt().div_(std::sqrt(correction2)).add_(kAdamEpsilon);
  p.addcdiv_(mean_, denominator, -lr / correction1);
  g.zero_();
}

}  // namespace volalign

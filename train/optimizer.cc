#include "train/optimizer.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/zeros_like.h>
#include <c10/core/GradMode.h>

#include <cmath>

namespace volalign {
namespace {

constexpr double kAdamEpsilon = 1e-8;

std::vector<std::string> MomentNames(OptimizerKind kind) {
  if (kind == OptimizerKind::kSgd) return {"momentum"};
  return {"mean", "square"};
}

}  // namespace

Optimizer::Optimizer(const OptimConfig& config, FlatModule* module)
    : config_(config), module_(module) {
  for (const std::string& name : MomentNames(config.optimizer)) {
    moments_.emplace_back(name, at::zeros_like(module->parameters()));
  }
}

at::Tensor Optimizer::GradientNorm() const { return module_->gradients().norm(); }

void Optimizer::Step(double lr, const at::Tensor& gradient_norm) {
  c10::NoGradGuard no_grad;
  at::Tensor& g = module_->gradients();
  if (config_.clip_norm > 0) g.mul_((config_.clip_norm / (gradient_norm + 1e-6)).clamp_max(1.0));
  ++steps_;
  if (config_.optimizer == OptimizerKind::kSgd) {
    StepSgd(lr);
  } else {
    StepAdam(lr);
  }
  g.zero_();
}

void Optimizer::StepAdam(double lr) {
  at::Tensor& p = module_->parameters();
  const at::Tensor& g = module_->gradients();
  at::Tensor& mean = moments_[0].second;
  at::Tensor& square = moments_[1].second;
  mean.lerp_(g, 1 - config_.beta1);
  square.mul_(config_.beta2).addcmul_(g, g, 1 - config_.beta2);
  const double correction1 = 1 - std::pow(config_.beta1, static_cast<double>(steps_));
  const double correction2 = 1 - std::pow(config_.beta2, static_cast<double>(steps_));
  if (config_.weight_decay > 0) {
    p.narrow(0, 0, module_->num_weights()).mul_(1 - lr * config_.weight_decay);
  }
  const at::Tensor denominator = square.sqrt().div_(std::sqrt(correction2)).add_(kAdamEpsilon);
  p.addcdiv_(mean, denominator, -lr / correction1);
}

void Optimizer::StepSgd(double lr) {
  at::Tensor& p = module_->parameters();
  at::Tensor& g = module_->gradients();
  at::Tensor& momentum = moments_[0].second;
  if (config_.weight_decay > 0) {
    const std::int64_t n = module_->num_weights();
    g.narrow(0, 0, n).add_(p.narrow(0, 0, n), config_.weight_decay);
  }
  momentum.mul_(config_.momentum).add_(g);
  p.add_(config_.nesterov ? g.add_(momentum, config_.momentum) : momentum, -lr);
}

}  // namespace volalign

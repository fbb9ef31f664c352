#include "train/optimizer.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/zeros_like.h>
#include <c10/core/GradMode.h>

#include <cmath>

namespace volalign {
namespace {

constexpr double kAdamEpsilon = 1e-8;

}  // namespace

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

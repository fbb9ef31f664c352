#include "train/optimizer.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/where.h>
#include <ATen/ops/zeros_like.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "core/base/error.h"
#include "core/nn/cpu/torch_threads.h"

namespace volalign {
namespace {

constexpr double kAdamEpsilon = 1e-8;
/// Number of values for which all operations of a step are done one after another, so that they
/// stay in the second-level cache.
constexpr std::int64_t kPiece = 32768;
/// Number of values of which a step that may be undone keeps copies at a time.
constexpr std::int64_t kUnseenPiece = 1 << 22;

void StepAdam(bool decoupled, OptimizerStep& step) {
  const double decay = step.weight_decay;
  at::Tensor &mean = step.moments[0], &square = step.moments[1];
  if (decay > 0 && !decoupled) step.gradient.add_(step.weights, decay);
  mean.lerp_(step.gradient, 1 - step.beta1);
  square.mul_(step.beta2).addcmul_(step.gradient, step.gradient, 1 - step.beta2);
  const double correction1 = 1 - std::pow(step.beta1, static_cast<double>(step.number));
  const double correction2 = 1 - std::pow(step.beta2, static_cast<double>(step.number));
  if (decay > 0 && decoupled) step.weights.mul_(1 - step.lr * decay);
  const at::Tensor denominator = square.sqrt().div_(std::sqrt(correction2)).add_(kAdamEpsilon);
  step.weights.addcdiv_(mean, denominator, -step.lr / correction1);
}

struct Rule {
  std::vector<std::string> moments;
  OptimizerRule step;
};

std::map<std::string, Rule>& Rules() {
  const std::vector<std::string> moments = {"mean", "square"};
  static std::map<std::string, Rule> rules = {
      {"adam", {moments, [](OptimizerStep& step) { StepAdam(false, step); }}},
      {"adamw", {moments, [](OptimizerStep& step) { StepAdam(true, step); }}}};
  return rules;
}

}  // namespace

void RegisterOptimizer(const std::string& name, std::vector<std::string> moments,
                       OptimizerRule rule) {
  if (!Rules().insert({name, {std::move(moments), std::move(rule)}}).second)
    throw Error(fmt::format("there is an optimizer '{}' already", name));
}

std::vector<std::string> OptimizerNames() {
  std::vector<std::string> names;
  for (const auto& [name, rule] : Rules()) names.push_back(name);
  return names;
}

Optimizer::Optimizer(const OptimConfig& config, FlatModule* module)
    : config_(config), module_(module) {
  const auto rule = Rules().find(config.optimizer);
  if (rule == Rules().end())
    throw ConfigError(fmt::format("there is no optimizer '{}'", config.optimizer));
  rule_ = rule->second.step;
  for (const std::string& name : rule->second.moments)
    moments_.emplace_back(name, at::zeros_like(module->parameters()));
}

at::Tensor Optimizer::GradientNorm() const { return module_->gradients().norm(); }

void Optimizer::Step(double lr, const at::Tensor& gradient_norm, const at::Tensor& finite) {
  c10::NoGradGuard no_grad;
  ++steps_;
  at::Tensor clip;
  if (config_.clip_norm > 0) clip = (config_.clip_norm / (gradient_norm + 1e-6)).clamp_max(1.0);
  const std::int64_t all = module_->parameters().numel(), weights = module_->num_weights();
  std::int64_t piece = module_->parameters().is_cpu() ? kPiece : all;
  if (finite.defined()) piece = kUnseenPiece;
  const auto step = [&](std::int64_t begin, std::int64_t end, bool decay) {
    const std::int64_t pieces = (end - begin + piece - 1) / piece;
    ForEachOnTorchThreads(pieces, [&](std::int64_t i) {
      c10::NoGradGuard no_grad_here;
      const std::int64_t first = begin + i * piece;
      StepPiece(first, std::min(piece, end - first), lr, clip, decay, finite);
    });
  };
  step(0, weights, config_.weight_decay > 0);
  step(weights, all, false);
}

void Optimizer::StepPiece(std::int64_t begin, std::int64_t count, double lr, const at::Tensor& clip,
                          bool decay, const at::Tensor& finite) {
  at::Tensor p = module_->parameters().narrow(0, begin, count),
             g = module_->gradients().narrow(0, begin, count);
  std::vector<at::Tensor> moments;
  for (const auto& [name, all] : moments_) moments.push_back(all.narrow(0, begin, count));
  std::vector<at::Tensor> before;
  if (finite.defined()) {
    before.push_back(p.clone());
    for (const at::Tensor& moment : moments) before.push_back(moment.clone());
  }
  if (clip.defined()) g.mul_(clip);
  OptimizerStep step{lr, config_.beta1, config_.beta2, decay ? config_.weight_decay : 0, steps_, p,
                     g,  moments};
  rule_(step);
  g.zero_();
  if (!finite.defined()) return;
  p.copy_(at::where(finite, p, before[0]));
  for (std::size_t i = 0; i < moments.size(); ++i)
    moments[i].copy_(at::where(finite, moments[i], before[i + 1]));
}

double LearningRate(const OptimConfig& config, std::int64_t samples, std::int64_t total) {
  const std::int64_t since = samples - config.warmup_samples;
  if (since < 0) {
    return config.lr * static_cast<double>(samples + 1) /
           static_cast<double>(config.warmup_samples + 1);
  }
  if (config.schedule == Schedule::kConstant) return config.lr;
  const double rest = static_cast<double>(std::max<std::int64_t>(1, total - config.warmup_samples));
  return config.lr * 0.5 * (1 + std::cos(M_PI * std::min(1.0, static_cast<double>(since) / rest)));
}

WeightAverage::WeightAverage(StructureNet net, double decay, FlatModule& source)
    : net_(std::move(net)), flat_(*net_), decay_(decay) {
  Reset(source);
}

void WeightAverage::Update(FlatModule& source, std::int64_t steps, const at::Tensor& finite) {
  if (decay_ == 0) return;
  c10::NoGradGuard no_grad;
  const double t = static_cast<double>(steps);
  const double weight = 1 - std::min(decay_, (1 + t) / (10 + t));
  const auto take = [&](const auto& share) {
    flat_.parameters().lerp_(source.parameters(), share);
    flat_.buffers().lerp_(source.buffers(), share);
  };
  if (finite.defined()) return take(at::Tensor(finite.to(at::kFloat) * weight));
  take(weight);
}

void WeightAverage::Refresh(FlatModule& source) {
  if (decay_ == 0) Reset(source);
}

void WeightAverage::Reset(FlatModule& source) {
  c10::NoGradGuard no_grad;
  flat_.parameters().copy_(source.parameters());
  flat_.buffers().copy_(source.buffers());
}

}  // namespace volalign

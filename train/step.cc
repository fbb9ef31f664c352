#include "train/step.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/cat.h>
#include <ATen/ops/isfinite.h>
#include <ATen/ops/ones_like.h>
#include <ATen/ops/stack.h>
#include <ATen/ops/where.h>
#include <ATen/ops/zeros_like.h>

#include <algorithm>
#include <chrono>

namespace volalign {
namespace {

using Clock = std::chrono::steady_clock;

double Seconds(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

/// Adds the gradient of a part of a batch. Returns its total, its degenerate samples and its terms
/// with their weights in the batch: [2 + N] float64.
at::Tensor AddGradient(TrainState& state, const TrainingLoss& loss, const Batch& part, double share,
                       const Compute& compute, std::int64_t samples, StepTimes* times) {
  const auto now = [&] {
    if (times != nullptr) Synchronize(compute.device);
    return Clock::now();
  };
  const auto start = now();
  const at::Tensor log_probs =
      state.net->forward(EncodeFor(compute, part.depth, state.net->options().input));  // [B,K,H,W]
  const auto forward = now();
  const LossTerms terms = loss({log_probs, part.depth, part.labels, part.rays}, samples, share);
  const auto compared = now();
  terms.total.backward();
  if (times != nullptr) {
    times->forward += Seconds(start, forward);
    times->loss += Seconds(forward, compared);
    times->backward += Seconds(compared, now());
  }
  std::vector<at::Tensor> values = {terms.total.detach().to(at::kDouble),
                                    terms.degenerate_samples.to(at::kDouble)};
  for (const at::Tensor& term : terms.terms)
    values.push_back(term.detach().to(at::kDouble) * share);
  return at::stack(values);
}

}  // namespace

at::Tensor StepNumbers::Sums() const {
  const at::Tensor kept = at::where(finite, values, at::zeros_like(values));
  const at::Tensor skipped = finite.logical_not().to(at::kDouble).view(1);
  return at::cat({kept, at::ones_like(skipped), skipped});
}

StepReport ReadSums(const at::Tensor& sums, const std::vector<std::string>& names) {
  const at::Tensor host = sums.to(at::kCPU);
  const double* value = host.data_ptr<double>();
  StepReport report;
  report.loss = *value++;
  report.degenerate_samples = static_cast<std::int64_t>(*value++);
  for (const std::string& name : names) report.terms[name] = *value++;
  report.gradient_norm = *value++;
  report.steps = static_cast<std::int64_t>(*value++);
  report.skipped = static_cast<std::int64_t>(*value++);
  return report;
}

StepNumbers ComputeGradient(TrainState& state, const TrainingLoss& loss, const Batch& batch,
                            const Compute& compute, std::int64_t samples, int micro_batch,
                            StepTimes* times, double share, ProcessGroup* group,
                            const std::function<void()>& between) {
  state.net->train();
  const std::int64_t size = batch.depth.size(0);
  const std::int64_t part = micro_batch == 0 ? size : micro_batch;
  at::Tensor sums;
  for (std::int64_t first = 0; first < size; first += part) {
    if (first > 0 && between) between();
    const std::int64_t count = std::min(part, size - first);
    const bool whole = count == size;
    const double of_part = share * static_cast<double>(count) / static_cast<double>(size);
    const at::Tensor terms = AddGradient(state, loss, whole ? batch : batch.Narrow(first, count),
                                         of_part, compute, samples, times);
    sums = sums.defined() ? sums + terms : terms;
  }
  if (group != nullptr) {
    const auto start = Clock::now();
    group->Sum(state.flat.gradients());
    group->Sum(sums);
    if (times != nullptr) times->backward += Seconds(start, Clock::now());
  }
  StepNumbers numbers;
  numbers.norm = state.optimizer.GradientNorm();
  numbers.values = at::cat({sums, numbers.norm.to(at::kDouble).view(1)});
  numbers.finite = at::isfinite(sums.select(0, 0)).logical_and(at::isfinite(numbers.norm));
  return numbers;
}

}  // namespace volalign

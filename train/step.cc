#include "train/step.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/cat.h>
#include <ATen/ops/stack.h>

#include <algorithm>
#include <chrono>

namespace volalign {
namespace {

using Clock = std::chrono::steady_clock;

double Seconds(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

/// Adds the gradient of a part of a batch, and returns its total, segmentation and Procrustes loss
/// as they count in the batch's, and its degenerate samples: [4] float64.
at::Tensor AddGradient(Learner& learner, const TrainingLoss& loss, const Batch& part,
                       const LossShare& share, const Compute& compute, std::int64_t samples,
                       StepTimes* times) {
  const auto start = Clock::now();
  const at::Tensor log_probs = learner.net->forward(
      EncodeFor(compute, part.depth, learner.net->options().input));  // [B,K,H,W]
  Synchronize(compute.device);
  const auto forward = Clock::now();
  const LossTerms terms = loss(log_probs, part.depth, part.labels, part.rays, samples, share);
  Synchronize(compute.device);
  const auto compared = Clock::now();
  terms.total.backward();
  Synchronize(compute.device);
  times->forward += Seconds(start, forward);
  times->loss += Seconds(forward, compared);
  times->backward += Seconds(compared, Clock::now());
  return at::stack({terms.total.detach().to(at::kDouble),
                    terms.segmentation.detach().to(at::kDouble) * share.segmentation,
                    terms.procrustes.detach().to(at::kDouble) * share.procrustes,
                    terms.degenerate.to(at::kDouble)});
}

}  // namespace

at::Tensor ComputeGradient(Learner& learner, const TrainingLoss& loss, const Batch& batch,
                           const Compute& compute, std::int64_t samples, int micro_batch,
                           StepReport* report, const LossShare& share, GradientReducer* reducer,
                           const std::function<void()>& between) {
  learner.net->train();
  const std::int64_t size = batch.depth.size(0);
  const std::int64_t part = micro_batch == 0 ? size : micro_batch;
  at::Tensor sums;
  for (std::int64_t first = 0; first < size; first += part) {
    if (first > 0 && between) between();
    const std::int64_t count = std::min(part, size - first);
    const bool whole = count == size;
    LossShare of_part = whole ? LossShare() : loss.ShareOf(batch.labels, first, count);
    of_part.segmentation *= share.segmentation;
    of_part.procrustes *= share.procrustes;
    if (reducer != nullptr && first + count == size) reducer->Arm();
    const at::Tensor terms = AddGradient(learner, loss, whole ? batch : batch.Narrow(first, count),
                                         of_part, compute, samples, &report->times);
    sums = sums.defined() ? sums + terms : terms;
  }
  if (reducer != nullptr) {
    const auto start = Clock::now();
    reducer->Finish();
    reducer->group().Sum(sums);
    report->times.backward += Seconds(start, Clock::now());
  }
  const at::Tensor norm = learner.optimizer.GradientNorm();
  // One transfer a step.
  const at::Tensor numbers = at::cat({sums, norm.to(at::kDouble).view(1)}).to(at::kCPU);
  const double* value = numbers.data_ptr<double>();
  report->loss = value[0];
  report->loss_seg = value[1];
  report->loss_3d = value[2];
  report->degenerate = static_cast<std::int64_t>(value[3]);
  report->gradient_norm = value[4];
  return norm;
}

}  // namespace volalign

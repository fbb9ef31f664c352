#include "train/step.h"

#include <ATen/ops/stack.h>

#include <chrono>

namespace volalign {
namespace {

using Clock = std::chrono::steady_clock;

double Seconds(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

}  // namespace

at::Tensor ComputeGradient(Learner& learner, const TrainingLoss& loss, const Batch& batch,
                           const Compute& compute, std::int64_t samples, StepReport* report) {
  const auto start = Clock::now();
  learner.net->train();
  const at::Tensor log_probs = learner.net->forward(
      EncodeFor(compute, batch.depth, learner.net->options().input));  // [B,K,H,W]
  Synchronize(compute.device);
  const auto forward = Clock::now();
  const LossTerms terms = loss(log_probs, batch.depth, batch.labels, batch.rays, samples);
  Synchronize(compute.device);
  const auto compared = Clock::now();
  terms.total.backward();
  Synchronize(compute.device);
  const auto backward = Clock::now();
  const at::Tensor norm = learner.optimizer.GradientNorm();
  // One transfer a step.
  const at::Tensor numbers =
      at::stack({terms.total.detach().to(at::kDouble), terms.segmentation.detach().to(at::kDouble),
                 terms.procrustes.detach().to(at::kDouble), terms.degenerate.to(at::kDouble),
                 norm.to(at::kDouble)})
          .to(at::kCPU);
  const double* value = numbers.data_ptr<double>();
  report->loss = value[0];
  report->loss_seg = value[1];
  report->loss_3d = value[2];
  report->degenerate = static_cast<std::int64_t>(value[3]);
  report->gradient_norm = value[4];
  report->times.forward = Seconds(start, forward);
  report->times.loss = Seconds(forward, compared);
  report->times.backward = Seconds(compared, backward);
  return norm;
}

}  // namespace volalign

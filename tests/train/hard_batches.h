#pragma once

#include <ATen/ATen.h>
#include <torch/csrc/autograd/autograd.h>

#include <cstdint>
#include <string>

#include "train/batch.h"
#include "train/losses.h"

namespace volalign {

/// A batch for the training loss whose samples are each of a kind on which a gradient could fail,
/// or random: no depth, a single pixel, a row, a plane, one distance, tiny and huge distances,
/// probabilities of exactly 0 and 1, right and wrong, equal everywhere, equal in all classes, a
/// single visible side, mirrored rays. Drawn from ATen's generator.
struct HardBatch {
  at::Tensor logits;  ///< [B,K,H,W]
  Batch batch;
};

inline constexpr std::int64_t kHardKinds = 13;

inline void MakeHard(std::int64_t kind, const at::Tensor& logits, const at::Tensor& depth,
                     const at::Tensor& labels, const at::Tensor& rays) {
  const at::Tensor right = (at::zeros_like(logits) - 1e4).scatter(0, labels.unsqueeze(0), 1e4);
  switch (kind) {
    case 0:
      break;  // random
    case 1:
      depth.zero_();
      break;
    case 2:
      depth.zero_();
      depth[0][3][2] = 1.5;
      break;
    case 3:
      depth.narrow(1, 1, depth.size(1) - 1).zero_();
      break;
    case 4:
      depth.fill_(2);
      break;
    case 5:
      depth.mul_(1e-5);
      break;
    case 6:
      depth.mul_(1e4);
      break;
    case 7:
      logits.copy_(right);
      break;
    case 8:
      logits.copy_(-right);
      break;
    case 9:
      logits.zero_();
      break;
    case 10:
      labels.copy_((labels > 10).to(at::kLong) * 7);
      break;
    case 11:
      rays[0].neg_();
      logits.copy_(right * 1e-3);
      break;
    case 12:
      rays.copy_(rays[0][0][0].expand_as(rays));
      depth.fill_(1);
      break;
    default:
      break;
  }
}

inline HardBatch DrawHardBatch(std::int64_t samples, std::int64_t classes, std::int64_t size = 8) {
  HardBatch hard;
  hard.logits = at::randn({samples, classes, size, size}) * 4;
  hard.batch.depth =
      (1 + at::rand({samples, 1, size, size})) * (at::rand({samples, 1, size, size}) > 0.2);
  hard.batch.labels = at::randint(0, classes, {samples, size, size}, at::kLong);
  hard.batch.rays = at::rand({samples, 2, size, size}) - 0.5;
  const at::Tensor kinds = at::randint(0, kHardKinds, {samples}, at::kLong);
  for (std::int64_t s = 0; s < samples; ++s) {
    MakeHard(kinds[s].item<std::int64_t>(), hard.logits[s], hard.batch.depth[s],
             hard.batch.labels[s], hard.batch.rays[s]);
  }
  return hard;
}

/// Whether the loss of a batch and its gradient with respect to the logits are finite.
inline bool FiniteLoss(const TrainingLoss& loss, const HardBatch& hard) {
  const at::Tensor logits = hard.logits.clone().requires_grad_(true);
  const LossTerms terms =
      loss(at::log_softmax(logits, 1), hard.batch.depth, hard.batch.labels, hard.batch.rays, 1);
  const at::Tensor gradient = torch::autograd::grad({terms.total}, {logits})[0];
  return at::isfinite(terms.total).logical_and(at::isfinite(gradient).all()).item<bool>();
}

}  // namespace volalign

#pragma once

#include <ATen/core/Tensor.h>

#include "core/geometry/structure.h"
#include "train/loss_term.h"
#include "train/train_config.h"

namespace volalign {

/// Mean negative log-likelihood over all pixels: log_probs [B,K,H,W], labels [B,H,W] int64 in [0,
/// K). Throws Error for other shapes or types.
at::Tensor SegmentationLoss(const at::Tensor& log_probs, const at::Tensor& labels);

/// bool [B,K-1]: label k has at least `min_pixels` pixels with depth. labels [B,H,W] int64, depth
/// [B,1,H,W].
at::Tensor VisibleSides(const at::Tensor& labels, const at::Tensor& depth, int num_classes,
                        int min_pixels);

struct LossTerms {
  at::Tensor total;               ///< scalar, differentiable: the weighted sum of `terms`
  at::Tensor degenerate_samples;  ///< int64 scalar, those that added nothing to loss_3d
  /// Scalars without their weights, in the order of TrainingLoss::names().
  std::vector<at::Tensor> terms;
};

/// L = L_seg + lambda L_3D (paper, section "Soft Procrustes") + the weighted loss.terms.
class TrainingLoss {
 public:
  TrainingLoss(const LossConfig& config, const Structure& structure, const at::Device& device);

  /// The terms' names in steps, logs and validations: loss_seg, loss_3d (m; 0 if it is switched
  /// off), then loss_NAME of each of loss.terms.
  const std::vector<std::string>& names() const { return names_; }

  /// The loss of a part of a batch. `total` is weighted with the part's `share` of the samples, so
  /// that the totals of all parts add up to the batch's. The terms are the part's own. The number
  /// of `samples` so far gives lambda, which rises linearly from 0 over lambda_warmup_samples.
  LossTerms operator()(const LossInput& part, std::int64_t samples, double share = 1) const;

 private:
  LossConfig config_;
  int num_classes_;
  at::Tensor targets_;  // [K-1,3], on the CPU
  std::vector<std::string> names_{"loss_seg", "loss_3d"};
  std::vector<LossTerm> terms_;
};

}  // namespace volalign

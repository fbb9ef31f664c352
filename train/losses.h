#pragma once

#include <ATen/core/Tensor.h>

#include "core/geometry/structure.h"
#include "train/loss_term.h"
#include "train/train_config.h"

namespace volalign {

/// Mean negative log-likelihood over all pixels: log_probs [B,K,H,W], labels [B,H,W] int64 in [0,
/// K). Where `weights` [K] is defined, the mean weighted by each pixel's label, and 0 where all
/// weights are. Throws Error for other shapes or types.
at::Tensor SegmentationLoss(const at::Tensor& log_probs, const at::Tensor& labels,
                            const at::Tensor& weights = {});

/// The weights of loss.class_weights, [K] float32, or an undefined tensor where there are none.
/// Throws ConfigError where their number is neither 2 nor K, or all are 0.
at::Tensor ClassWeights(const LossConfig& config, int num_classes);

/// bool [B,K-1]: label k has at least `min_pixels` pixels with depth. labels [B,H,W] int64, depth
/// [B,1,H,W].
at::Tensor VisibleSides(const at::Tensor& labels, const at::Tensor& depth, int num_classes,
                        int min_pixels);

struct LossTerms {
  at::Tensor total;         ///< scalar, differentiable, with loss.terms
  at::Tensor segmentation;  ///< scalar
  at::Tensor procrustes;    ///< scalar, m; 0 when it is switched off
  at::Tensor degenerate;    ///< int64 scalar, samples that added nothing to `procrustes`
};

/// Share of a batch's loss that falls on one of the parts that it is computed in.
struct LossShare {
  double segmentation = 1;  ///< of the pixels' weights
  double procrustes = 1;    ///< of the samples
  /// A further factor of `segmentation`, a scalar on the device, or undefined: 1. It is not read,
  /// so that the device need not be waited for.
  at::Tensor weighted;

  /// `x`, a segmentation loss or such, as it counts.
  at::Tensor OfSegmentation(const at::Tensor& x) const;
};

/// L = L_seg + lambda L_3D (paper, section "Soft Procrustes") + the weighted loss.terms.
class TrainingLoss {
 public:
  TrainingLoss(const LossConfig& config, const Structure& structure, const at::Device& device);

  /// `total` is that of `share`, the terms are the part's own.
  /// log_probs [B,K,H,W] float32, depth [B,1,H,W] m, labels [B,H,W] int64, rays [B,2,H,W];
  /// `samples` drawn so far sets lambda, which rises linearly from 0 over lambda_warmup_samples.
  LossTerms operator()(const at::Tensor& log_probs, const at::Tensor& depth,
                       const at::Tensor& labels, const at::Tensor& rays, std::int64_t samples,
                       const LossShare& share = LossShare()) const;

  /// Share of samples [first, first + count) of a batch with these labels [B,H,W]. `total` of the
  /// losses of all parts, with their shares, add up to that of the batch.
  LossShare ShareOf(const at::Tensor& labels, std::int64_t first, std::int64_t count) const;

  /// What the pixels with these labels [B,H,W] count in the segmentation loss.
  double WeightOf(const at::Tensor& labels) const;

 private:
  LossTerms PaperLoss(const at::Tensor& log_probs, const at::Tensor& depth,
                      const at::Tensor& labels, const at::Tensor& rays, std::int64_t samples,
                      const LossShare& share) const;

  LossConfig config_;
  int num_classes_;
  at::Tensor targets_;  // [K-1,3], on the CPU
  at::Tensor weights_;  // [K], or undefined
  std::vector<std::unique_ptr<LossTerm>> terms_;
};

}  // namespace volalign

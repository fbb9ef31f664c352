#include "train/losses.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/arange.h>
#include <ATen/ops/nll_loss_nd.h>
#include <ATen/ops/zeros.h>
#include <fmt/format.h>

#include <algorithm>

#include "core/error.h"
#include "train/soft_procrustes.h"

namespace volalign {

at::Tensor SegmentationLoss(const at::Tensor& log_probs, const at::Tensor& labels) {
  if (log_probs.dim() != 4 || labels.dim() != 3 || labels.size(0) != log_probs.size(0) ||
      labels.size(1) != log_probs.size(2) || labels.size(2) != log_probs.size(3) ||
      labels.scalar_type() != at::kLong) {
    throw Error(
        fmt::format("SegmentationLoss needs log-probabilities [B,K,H,W] and int64 labels [B,H,W], "
                    "not [{}] and [{}]",
                    fmt::join(log_probs.sizes().begin(), log_probs.sizes().end(), ","),
                    fmt::join(labels.sizes().begin(), labels.sizes().end(), ",")));
  }
  return at::nll_loss_nd(log_probs, labels);
}

at::Tensor VisibleSides(const at::Tensor& labels, const at::Tensor& depth, int num_classes,
                        int min_pixels) {
  const std::int64_t batch = labels.size(0);
  const at::Tensor measured = labels * (depth.select(1, 0) > 0);  // [B,H,W]
  // One histogram a sample: bin b K + k holds the pixels of label k in sample b.
  const at::Tensor offsets = at::arange(batch, labels.options()).view({-1, 1}) * num_classes;
  const at::Tensor bins = measured.flatten(1) + offsets;
  const at::Tensor counts =
      bins.flatten().bincount({}, batch * num_classes).view({batch, num_classes});
  return counts.narrow(1, 1, num_classes - 1) >= min_pixels;
}

TrainingLoss::TrainingLoss(const LossConfig& config, const Structure& structure,
                           const at::Device& device)
    : config_(config),
      num_classes_(structure.num_classes()),
      targets_(StructureKeypoints(structure, ParseKeypointKind(config.keypoints)).to(device)) {}

LossTerms TrainingLoss::operator()(const at::Tensor& log_probs, const at::Tensor& depth,
                                   const at::Tensor& labels, const at::Tensor& rays,
                                   std::int64_t samples) const {
  LossTerms terms;
  terms.segmentation = SegmentationLoss(log_probs, labels);
  if (!config_.procrustes) {
    terms.total = terms.segmentation;
    terms.procrustes = at::zeros({}, log_probs.options().requires_grad(false));
    terms.degenerate = at::zeros({}, labels.options());
    return terms;
  }
  const at::Tensor keypoints = SoftKeypoints(log_probs, Deproject(depth, rays));
  const ProcrustesLoss loss = SoftProcrustesLoss(
      keypoints, targets_, VisibleSides(labels, depth, num_classes_, config_.min_side_pixels));
  const double ramp = config_.lambda_warmup_samples == 0
                          ? 1.0
                          : std::min(1.0, static_cast<double>(samples) /
                                              static_cast<double>(config_.lambda_warmup_samples));
  terms.total = terms.segmentation + config_.lambda * ramp * loss.loss;
  terms.procrustes = loss.loss;
  terms.degenerate = loss.degenerate;
  return terms;
}

}  // namespace volalign

#include "train/losses.h"

#include <ATen/TensorOperators.h>
#include <ATen/core/Reduction.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/nll_loss_nd.h>
#include <ATen/ops/zeros.h>
#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "core/base/error.h"
#include "train/pixel_loss.h"
#include "train/soft_procrustes.h"

namespace volalign {

at::Tensor SegmentationLoss(const at::Tensor& log_probs, const at::Tensor& labels,
                            const at::Tensor& weights) {
  if (log_probs.dim() != 4 || labels.dim() != 3 || labels.size(0) != log_probs.size(0) ||
      labels.size(1) != log_probs.size(2) || labels.size(2) != log_probs.size(3) ||
      labels.scalar_type() != at::kLong) {
    throw Error(
        fmt::format("SegmentationLoss needs log-probabilities [B,K,H,W] and int64 labels [B,H,W], "
                    "not [{}] and [{}]",
                    fmt::join(log_probs.sizes().begin(), log_probs.sizes().end(), ","),
                    fmt::join(labels.sizes().begin(), labels.sizes().end(), ",")));
  }
  if (!weights.defined()) return at::nll_loss_nd(log_probs, labels);
  // Not the mean of nll_loss_nd, which is 0 / 0 where no pixel has weight.
  const at::Tensor sum = at::nll_loss_nd(log_probs, labels, weights, at::Reduction::Sum);
  return sum / weights.index_select(0, labels.flatten()).sum().clamp_min(1e-12);
}

at::Tensor LossShare::OfSegmentation(const at::Tensor& x) const {
  const at::Tensor own = x * segmentation;
  return weighted.defined() ? own * weighted.to(x.scalar_type()) : own;
}

at::Tensor ClassWeights(const LossConfig& config, int num_classes) {
  std::vector<double> given = config.class_weights;
  if (given.empty()) return {};
  if (given.size() == 2) given.resize(static_cast<std::size_t>(num_classes), given[1]);
  if (given.size() != static_cast<std::size_t>(num_classes)) {
    throw ConfigError(fmt::format(
        "loss.class_weights has {} numbers: give 2 (background, every side) or {}, one for each "
        "label of the structure, background first",
        given.size(), num_classes));
  }
  const std::vector<float> weights(given.begin(), given.end());
  if (std::all_of(weights.begin(), weights.end(), [](float w) { return w == 0; })) {
    throw ConfigError("loss.class_weights are all 0");
  }
  at::Tensor result = at::empty({num_classes}, at::kFloat);
  std::copy(weights.begin(), weights.end(), result.data_ptr<float>());
  return result;
}

at::Tensor VisibleSides(const at::Tensor& labels, const at::Tensor& depth, int num_classes,
                        int min_pixels) {
  const at::Tensor measured = (depth.select(1, 0) > 0).to(at::kLong).flatten(1);  // [B,HW]
  const at::Tensor counts = at::zeros({labels.size(0), num_classes}, labels.options())
                                .scatter_add_(1, labels.flatten(1), measured);
  return counts.narrow(1, 1, num_classes - 1) >= min_pixels;
}

TrainingLoss::TrainingLoss(const LossConfig& config, const Structure& structure,
                           const at::Device& device)
    : config_(config),
      num_classes_(structure.num_classes()),
      targets_(StructureKeypoints(structure, ParseKeypointKind(config.keypoints))),
      weights_(ClassWeights(config, num_classes_)) {
  if (weights_.defined()) weights_ = weights_.to(device);
  for (const std::string& name : config.terms)
    terms_.push_back(MakeLossTerm(name, structure, device));
}

LossShare TrainingLoss::ShareOf(const at::Tensor& labels, std::int64_t first,
                                std::int64_t count) const {
  LossShare share;
  share.procrustes = static_cast<double>(count) / static_cast<double>(labels.size(0));
  share.segmentation = share.procrustes;
  if (!weights_.defined()) return share;
  const at::Tensor of_pixel = weights_.index_select(0, labels.flatten()).to(at::kDouble);
  const at::Tensor of_sample = of_pixel.view({labels.size(0), -1}).sum(1);
  share.segmentation = 1;
  share.weighted = of_sample.narrow(0, first, count).sum() / of_sample.sum().clamp_min(1e-12);
  return share;
}

double TrainingLoss::WeightOf(const at::Tensor& labels) const {
  if (!weights_.defined()) return static_cast<double>(labels.numel());
  return weights_.index_select(0, labels.flatten()).to(at::kDouble).sum().item<double>();
}

LossTerms TrainingLoss::operator()(const at::Tensor& log_probs, const at::Tensor& depth,
                                   const at::Tensor& labels, const at::Tensor& rays,
                                   std::int64_t samples, const LossShare& share) const {
  LossTerms terms = PaperLoss(log_probs, depth, labels, rays, samples, share);
  for (std::size_t i = 0; i < terms_.size(); ++i) {
    terms.total = terms.total + share.procrustes * config_.term_weights[i] *
                                    (*terms_[i])({log_probs, depth, labels, rays});
  }
  return terms;
}

LossTerms TrainingLoss::PaperLoss(const at::Tensor& log_probs, const at::Tensor& depth,
                                  const at::Tensor& labels, const at::Tensor& rays,
                                  std::int64_t samples, const LossShare& share) const {
  LossTerms terms;
  if (!config_.procrustes) {
    terms.segmentation = SegmentationLoss(log_probs, labels, weights_);
    terms.total = share.OfSegmentation(terms.segmentation);
    terms.procrustes = at::zeros({}, log_probs.options().requires_grad(false));
    terms.degenerate = at::zeros({}, labels.options());
    return terms;
  }
  at::Tensor keypoints, visible;
  if (log_probs.is_cpu()) {
    const PixelTerms pixels = ComputePixelTerms(log_probs, labels, depth, rays, weights_);
    terms.segmentation = pixels.segmentation;
    keypoints = pixels.keypoints;
    visible = pixels.measured.narrow(1, 1, num_classes_ - 1) >= config_.min_side_pixels;
  } else {
    terms.segmentation = SegmentationLoss(log_probs, labels, weights_);
    keypoints = SoftKeypoints(log_probs, Deproject(depth, rays));
    visible = VisibleSides(labels, depth, num_classes_, config_.min_side_pixels);
  }
  const ProcrustesLoss loss = SoftProcrustesLoss(keypoints, targets_, visible);
  const double ramp = config_.lambda_warmup_samples == 0
                          ? 1.0
                          : std::min(1.0, static_cast<double>(samples) /
                                              static_cast<double>(config_.lambda_warmup_samples));
  terms.total = share.OfSegmentation(terms.segmentation) +
                share.procrustes * config_.lambda * ramp * loss.loss;
  terms.procrustes = loss.loss;
  terms.degenerate = loss.degenerate;
  return terms;
}

}  // namespace volalign

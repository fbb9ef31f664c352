#include "train/losses.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/nll_loss_nd.h>
#include <ATen/ops/zeros.h>
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "train/soft_procrustes.h"

namespace volalign {
namespace {

std::map<std::string, LossTermFactory>& Registered() {
  // The paper's terms loss_seg and loss_3d always exist (train/losses.h).
  static std::map<std::string, LossTermFactory> registered = {{"seg", nullptr}, {"3d", nullptr}};
  return registered;
}

}  // namespace

void RegisterLossTerm(const std::string& name, LossTermFactory factory) {
  if (!Registered().emplace(name, std::move(factory)).second)
    throw Error(fmt::format("there is a loss term '{}' already", name));
}

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
  const at::Tensor measured = (depth.select(1, 0) > 0).to(at::kLong).flatten(1);  // [B,HW]
  const at::Tensor counts = at::zeros({labels.size(0), num_classes}, labels.options())
                                .scatter_add_(1, labels.flatten(1), measured);
  return counts.narrow(1, 1, num_classes - 1) >= min_pixels;
}

TrainingLoss::TrainingLoss(const LossConfig& config, const Structure& structure,
                           const at::Device& device)
    : config_(config),
      num_classes_(structure.num_classes()),
      targets_(StructureKeypoints(structure, config.keypoints)) {
  for (const std::string& name : config.terms) {
    const auto found = Registered().find(name);
    if (found == Registered().end() || !found->second) {
      throw ConfigError(
          fmt::format("loss.terms: '{}' is unknown: volalign has none of its own; a program "
                      "registers them (train/loss_term.h)",
                      name));
    }
    terms_.push_back(found->second(structure, device));
    names_.push_back("loss_" + name);
  }
}

LossTerms TrainingLoss::operator()(const LossInput& part, std::int64_t samples,
                                   double share) const {
  const auto& [log_probs, depth, labels, rays] = part;
  const at::Tensor segmentation = SegmentationLoss(log_probs, labels);
  LossTerms loss{share * segmentation,
                 at::zeros({}, labels.options()),
                 {segmentation, at::zeros({}, log_probs.options().requires_grad(false))}};
  if (config_.procrustes) {
    const at::Tensor keypoints = SoftKeypoints(log_probs, Deproject(depth, rays)),
                     visible = VisibleSides(labels, depth, num_classes_, config_.min_side_pixels);
    const ProcrustesLoss pose = SoftProcrustesLoss(keypoints, targets_, visible);
    const double ramp = config_.lambda_warmup_samples == 0
                            ? 1.0
                            : std::min(1.0, static_cast<double>(samples) /
                                                static_cast<double>(config_.lambda_warmup_samples));
    loss = {loss.total + share * config_.lambda * ramp * pose.loss,
            pose.degenerate_samples,
            {segmentation, pose.loss}};
  }
  for (std::size_t i = 0; i < terms_.size(); ++i) {
    loss.terms.push_back(terms_[i](part));
    loss.total = loss.total + share * config_.term_weights[i] * loss.terms.back();
  }
  return loss;
}

}  // namespace volalign

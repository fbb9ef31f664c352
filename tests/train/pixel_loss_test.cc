#include "train/pixel_loss.h"

#include <ATen/ATen.h>
#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>

#include <cstdint>

#include "core/base/error.h"
#include "tests/core/base/long_tests.h"
#include "train/batch.h"
#include "train/losses.h"
#include "train/soft_procrustes.h"

namespace volalign::pixel_loss_test {
namespace {

/// The one pass gives what the single functions give, and their gradients.
TEST(PixelTerms, AreThoseOfTheSingleFunctions) {
  const at::Tensor logits = at::randn({3, 6, 37, 41}) * 3;  // more than a block, no multiple of 16
  const at::Tensor labels = at::randint(0, 6, {3, 37, 41}, at::kLong);
  const at::Tensor depth = (at::rand({3, 1, 37, 41}) + 1) * (at::rand({3, 1, 37, 41}) > 0.3),
                   rays = at::randn({3, 2, 37, 41});
  const at::Tensor x = at::log_softmax(logits, 1).requires_grad_(true),
                   y = x.detach().clone().requires_grad_(true);
  const PixelTerms ours = ComputePixelTerms(x, labels, depth, rays);
  const at::Tensor segmentation = SegmentationLoss(y, labels),
                   keypoints = SoftKeypoints(y, Deproject(depth, rays));
  EXPECT_NEAR(ours.segmentation.item<double>(), segmentation.item<double>(), 1e-5);
  EXPECT_TRUE((ours.keypoints - keypoints).abs().max().item<double>() < 1e-5);
  for (int least : {1, 60, 180, 220}) {
    EXPECT_TRUE(
        (ours.measured.narrow(1, 1, 5) >= least).equal(VisibleSides(labels, depth, 6, least)));
  }
  const at::Tensor g = at::randn(keypoints.sizes());
  (ours.segmentation + (ours.keypoints * g).sum()).backward();
  (segmentation + (keypoints * g).sum()).backward();
  EXPECT_LT((x.grad() - y.grad()).norm().item<double>(), 1e-5 * y.grad().norm().item<double>());
}

TEST(PixelTerms, RefuseWrongInput) {
  const at::Tensor log_probs = at::zeros({1, 3, 4, 5}), labels = at::zeros({1, 4, 5}, at::kLong),
                   depth = at::ones({1, 1, 4, 5}), rays = at::ones({1, 2, 4, 5});
  EXPECT_THROW(ComputePixelTerms(log_probs, labels + 3, depth, rays), Error);
  EXPECT_THROW(ComputePixelTerms(log_probs, labels.to(at::kInt), depth, rays), Error);
  EXPECT_THROW(ComputePixelTerms(log_probs, labels, depth.narrow(2, 0, 3), rays), Error);
  EXPECT_THROW(ComputePixelTerms(log_probs, labels, depth, rays.narrow(1, 0, 1)), Error);
}

/// A batch for the training loss whose samples are each of a kind on which a gradient could fail,
/// or random: no depth, a single pixel, a row, a plane, one distance, tiny and huge distances,
/// probabilities of exactly 0 and 1, right and wrong, equal everywhere, equal in all classes, a
/// single visible side, mirrored rays. Drawn from ATen's generator.
struct HardBatch {
  at::Tensor logits;  ///< [B,K,H,W]
  Batch batch;
};

constexpr std::int64_t kHardKinds = 13;

void MakeHard(std::int64_t kind, const at::Tensor& logits, const at::Tensor& depth,
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

HardBatch DrawHardBatch(std::int64_t samples, std::int64_t classes, std::int64_t size = 8) {
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
bool FiniteLoss(const TrainingLoss& loss, const HardBatch& hard) {
  const at::Tensor logits = hard.logits.clone().requires_grad_(true);
  const LossTerms terms =
      loss(at::log_softmax(logits, 1), hard.batch.depth, hard.batch.labels, hard.batch.rays, 1);
  const at::Tensor gradient = torch::autograd::grad({terms.total}, {logits})[0];
  return at::isfinite(terms.total).logical_and(at::isfinite(gradient).all()).item<bool>();
}

TEST(TrainingLoss, IsFiniteWithItsGradientForHardBatches) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  LossConfig config;
  config.keypoints = KeypointKind::kExposed;
  const TrainingLoss loss(config, structure, at::kCPU);
  for (std::uint64_t i = 0; i < Rounds(100, 62500); ++i)
    ASSERT_TRUE(FiniteLoss(loss, DrawHardBatch(16, structure.num_classes()))) << i;
}

}  // namespace
}  // namespace volalign::pixel_loss_test

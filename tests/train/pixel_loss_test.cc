#include "train/pixel_loss.h"

#include <ATen/ATen.h>
#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>

#include "core/base/error.h"
#include "tests/train/hard_batches.h"
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

/// A small share of what tests/bench/loss_soak.cc does with a million.
TEST(TrainingLoss, IsFiniteWithItsGradientForHardBatches) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  LossConfig config;
  config.keypoints = KeypointKind::kExposed;
  const TrainingLoss loss(config, structure, at::kCPU);
  for (int i = 0; i < 100; ++i)
    ASSERT_TRUE(FiniteLoss(loss, DrawHardBatch(16, structure.num_classes()))) << i;
}

}  // namespace
}  // namespace volalign::pixel_loss_test

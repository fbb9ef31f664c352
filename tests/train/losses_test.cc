#include "train/losses.h"

#include <ATen/ATen.h>
#include <ATen/TensorOperators.h>
#include <ATen/ops/arange.h>
#include <ATen/ops/log_softmax.h>
#include <ATen/ops/rand.h>
#include <ATen/ops/randint.h>
#include <ATen/ops/randn.h>
#include <ATen/ops/zeros_like.h>
#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>

#include <cstdint>
#include <iterator>

#include "tests/core/base/expect_error.h"
#include "tests/core/base/long_tests.h"
#include "tests/train/synthetic_source.h"
#include "train/batch.h"

namespace volalign::losses_test {
namespace {

TEST(SegmentationLoss, IsTheMeanOverAllPixels) {
  const at::Tensor log_probs = at::log_softmax(at::randn({2, 5, 4, 3}).to(at::kDouble), 1);
  const at::Tensor labels = at::randint(0, 5, {2, 4, 3}, at::kLong);
  EXPECT_NEAR(SegmentationLoss(log_probs, labels).item<double>(),
              -log_probs.gather(1, labels.unsqueeze(1)).mean().item<double>(), 1e-12);
  EXPECT_THROW(SegmentationLoss(log_probs, labels.to(at::kInt)), Error);
  EXPECT_THROW(SegmentationLoss(log_probs, labels.narrow(1, 0, 3)), Error);
}

TEST(VisibleSides, CountsPixelsWithDepth) {
  const at::Tensor labels = at::randint(0, 4, {3, 6, 5}, at::kLong);
  const at::Tensor depth = (at::rand({3, 1, 6, 5}) > 0.4).to(at::kFloat);
  const at::Tensor seen = at::one_hot(labels, 4) * depth.squeeze(1).unsqueeze(3);
  const at::Tensor pixels = seen.sum({1, 2}).narrow(1, 1, 3);
  for (int least : {1, 4, 6})
    EXPECT_TRUE(VisibleSides(labels, depth, 4, least).equal(pixels >= least)) << least;
}

TEST(TrainingLoss, PerfectSegmentationOfARenderedViewHasASmallPoseTerm) {
  const TrainingData data = SyntheticData(4, 64, 1000);
  const Batch batch = Collate(data.open_training(0)());
  at::Tensor logits = at::randn({4, 21, 64, 64}) * 0.01;
  logits.scatter_(1, batch.labels.unsqueeze(1), 30.0);
  LossConfig config;
  config.keypoints = KeypointKind::kExposed;
  config.min_side_pixels = 20;
  const TrainingLoss loss(config, data.structure, at::kCPU);
  const LossTerms good =
      loss({at::log_softmax(logits, 1), batch.depth, batch.labels, batch.rays}, 1);
  const LossTerms blind = loss(
      {at::log_softmax(at::randn({4, 21, 64, 64}), 1), batch.depth, batch.labels, batch.rays}, 1);
  // Occlusion and the unweighted pixel mean keep soft keypoints off the exposed centroids by
  // centimetres.
  EXPECT_LT(good.terms[1].item<double>(), 0.35);
  EXPECT_GT(blind.terms[1].item<double>(), 3 * good.terms[1].item<double>());
  EXPECT_EQ(good.degenerate_samples.item<std::int64_t>(), 0);
}

TEST(TrainingLoss, LambdaRisesOverTheWarmUp) {
  const TrainingData data = SyntheticData(2, 32, 1000);
  const Batch batch = Collate(data.open_training(0)());
  const at::Tensor log_probs = at::log_softmax(at::randn({2, 21, 32, 32}), 1);
  LossConfig config;
  config.lambda = 0.5;
  config.lambda_warmup_samples = 1000;
  const TrainingLoss loss(config, data.structure, at::kCPU);
  const std::vector<std::pair<int, double>> expected = {
      {0, 0.0}, {250, 0.125}, {1000, 0.5}, {9999, 0.5}};
  for (const auto& [samples, lambda] : expected) {
    const LossTerms t = loss({log_probs, batch.depth, batch.labels, batch.rays}, samples);
    EXPECT_NEAR(t.total.item<double>(),
                t.terms[0].item<double>() + lambda * t.terms[1].item<double>(), 1e-6);
    EXPECT_GT(t.terms[1].item<double>(), 0);
  }
  config.procrustes = false;
  const LossTerms off = TrainingLoss(config, data.structure, at::kCPU)(
      {log_probs, batch.depth, batch.labels, batch.rays}, 9999);
  EXPECT_EQ(off.total.item<double>(), off.terms[0].item<double>());
  EXPECT_EQ(off.terms[1].item<double>(), 0);
}

at::Tensor MeanBackground(const LossInput& input) {
  return input.log_probs.select(1, 0).exp().mean();
}

TEST(TrainingLoss, AddsRegisteredTerms) {
  const TrainingData data = SyntheticData(2, 32, 1000);
  const Batch batch = Collate(data.open_training(0)());
  const at::Tensor log_probs = at::log_softmax(at::randn({2, 21, 32, 32}), 1).requires_grad_();
  LossConfig config;
  config.procrustes = false;
  config.terms = {"background"};
  config.term_weights = {0.25};
  ExpectError<ConfigError>([&] { TrainingLoss(config, data.structure, at::kCPU); },
                           {"loss.terms", "'background'"});
  RegisterLossTerm("background", [](const Structure& of, const at::Device& device) {
    EXPECT_EQ(of.num_classes(), 21);
    EXPECT_EQ(device, at::Device(at::kCPU));
    return MeanBackground;
  });
  EXPECT_THROW(RegisterLossTerm("background", nullptr), Error);
  const TrainingLoss loss(config, data.structure, at::kCPU);
  const LossTerms whole = loss({log_probs, batch.depth, batch.labels, batch.rays}, 0);
  const double background = log_probs.select(1, 0).exp().mean().item<double>();
  EXPECT_NEAR(whole.total.item<double>(), whole.terms[0].item<double>() + 0.25 * background, 1e-6);
  EXPECT_EQ(loss.names(), (std::vector<std::string>{"loss_seg", "loss_3d", "loss_background"}));
  ASSERT_EQ(whole.terms.size(), 3U);
  EXPECT_NEAR(whole.terms[2].item<double>(), background, 1e-6);
  EXPECT_THROW(RegisterLossTerm("seg", nullptr), Error);  // loss_seg is there
  // Of a batch in two parts: as much as of the whole.
  double parts = 0;
  for (std::int64_t i = 0; i < 2; ++i) {
    const Batch part = batch.Narrow(i, 1);
    parts += loss({log_probs.narrow(0, i, 1), part.depth, part.labels, part.rays}, 0, 0.5)
                 .total.item<double>();
  }
  EXPECT_NEAR(parts, whole.total.item<double>(), 1e-6);
  whole.total.backward();
  EXPECT_GT(log_probs.grad().select(1, 0).abs().sum().item<double>(), 0);
}

/// A batch for the training loss whose samples are each of a kind on which a gradient could fail,
/// or random: no depth, a single pixel, a row, a plane, one distance, tiny and huge distances,
/// probabilities of exactly 0 and 1, right and wrong, equal everywhere, equal in all classes, a
/// single visible side, mirrored rays. Drawn from ATen's generator.
struct HardBatch {
  at::Tensor logits;  ///< [B,K,H,W]
  Batch batch;
};

/// A sample of a HardBatch, and the logits of exactly its labels.
struct HardSample {
  at::Tensor logits, depth, labels, rays, right;
};

/// One kind more than these leaves the sample as it is.
constexpr void (*kMakeHard[])(const HardSample&) = {
    [](const HardSample& s) { s.depth.zero_(); },
    [](const HardSample& s) { s.depth.zero_()[0][3][2] = 1.5; },
    [](const HardSample& s) { s.depth.narrow(1, 1, s.depth.size(1) - 1).zero_(); },
    [](const HardSample& s) { s.depth.fill_(2); },
    [](const HardSample& s) { s.depth.mul_(1e-5); },
    [](const HardSample& s) { s.depth.mul_(1e4); },
    [](const HardSample& s) { s.logits.copy_(s.right); },
    [](const HardSample& s) { s.logits.copy_(-s.right); },
    [](const HardSample& s) { s.logits.zero_(); },
    [](const HardSample& s) { s.labels.copy_((s.labels > 10).to(at::kLong) * 7); },
    [](const HardSample& s) {
      s.rays[0].neg_();
      s.logits.copy_(s.right * 1e-3);
    },
    [](const HardSample& s) {
      s.rays.copy_(s.rays[0][0][0].expand_as(s.rays));
      s.depth.fill_(1);
    }};

HardBatch DrawHardBatch(std::int64_t samples, std::int64_t classes, std::int64_t size = 8) {
  HardBatch hard;
  hard.logits = at::randn({samples, classes, size, size}) * 4;
  hard.batch.depth =
      (1 + at::rand({samples, 1, size, size})) * (at::rand({samples, 1, size, size}) > 0.2);
  hard.batch.labels = at::randint(0, classes, {samples, size, size}, at::kLong);
  hard.batch.rays = at::rand({samples, 2, size, size}) - 0.5;
  constexpr std::int64_t kKinds = std::size(kMakeHard);
  const at::Tensor kinds = at::randint(0, kKinds + 1, {samples}, at::kLong);
  for (std::int64_t i = 0; i < samples; ++i) {
    const at::Tensor logits = hard.logits[i], labels = hard.batch.labels[i];
    const at::Tensor right = (at::zeros_like(logits) - 1e4).scatter(0, labels.unsqueeze(0), 1e4);
    const auto kind = kinds[i].item<std::int64_t>();
    if (kind < kKinds)
      kMakeHard[kind]({logits, hard.batch.depth[i], labels, hard.batch.rays[i], right});
  }
  return hard;
}

/// Whether the loss of a batch and its gradient with respect to the logits are finite.
bool FiniteLoss(const TrainingLoss& loss, const HardBatch& hard) {
  const at::Tensor logits = hard.logits.clone().requires_grad_(true);
  const LossTerms terms =
      loss({at::log_softmax(logits, 1), hard.batch.depth, hard.batch.labels, hard.batch.rays}, 1);
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
}  // namespace volalign::losses_test

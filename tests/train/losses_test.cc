#include "train/losses.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/arange.h>
#include <ATen/ops/log_softmax.h>
#include <ATen/ops/rand.h>
#include <ATen/ops/randint.h>
#include <ATen/ops/randn.h>
#include <ATen/ops/zeros_like.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
#include "tests/train/synthetic_source.h"

namespace volalign::losses_test {
namespace {

TEST(SegmentationLoss, IsTheMeanOverAllPixels) {
  const at::Tensor log_probs = at::log_softmax(at::randn({2, 5, 4, 3}).to(at::kDouble), 1);
  const at::Tensor labels = at::randint(0, 5, {2, 4, 3}, at::kLong);
  double sum = 0;
  for (int b = 0; b < 2; ++b) {
    for (int v = 0; v < 4; ++v) {
      for (int u = 0; u < 3; ++u) {
        sum -= log_probs[b][labels[b][v][u].item<std::int64_t>()][v][u].item<double>();
      }
    }
  }
  EXPECT_NEAR(SegmentationLoss(log_probs, labels).item<double>(), sum / 24, 1e-12);
  EXPECT_THROW(SegmentationLoss(log_probs, labels.to(at::kInt)), Error);
  EXPECT_THROW(SegmentationLoss(log_probs, labels.narrow(1, 0, 3)), Error);
}

TEST(VisibleSides, CountsPixelsWithDepth) {
  const at::Tensor labels = at::randint(0, 4, {3, 6, 5}, at::kLong);
  const at::Tensor depth = (at::rand({3, 1, 6, 5}) > 0.4).to(at::kFloat);
  for (int least : {1, 4, 6}) {
    const at::Tensor visible = VisibleSides(labels, depth, 4, least);
    ASSERT_EQ(visible.sizes(), at::IntArrayRef({3, 3}));
    for (int b = 0; b < 3; ++b) {
      for (int k = 1; k < 4; ++k) {
        int count = 0;
        for (int v = 0; v < 6; ++v) {
          for (int u = 0; u < 5; ++u) {
            count +=
                labels[b][v][u].item<std::int64_t>() == k && depth[b][0][v][u].item<float>() > 0;
          }
        }
        EXPECT_EQ(visible[b][k - 1].item<bool>(), count >= least);
      }
    }
  }
}

TEST(TrainingLoss, PerfectSegmentationOfARenderedViewHasASmallPoseTerm) {
  const TrainingData data = SyntheticData(4, 64, 1000);
  const Batch batch = Collate(data.open_training(0)->Next());
  at::Tensor logits = at::randn({4, 21, 64, 64}) * 0.01;
  logits.scatter_(1, batch.labels.unsqueeze(1), 30.0);
  LossConfig config;
  config.keypoints = KeypointKind::kExposed;
  config.min_side_pixels = 20;
  const TrainingLoss loss(config, data.structure, at::kCPU);
  const LossTerms good = loss(at::log_softmax(logits, 1), batch.depth, batch.labels, batch.rays, 1);
  const LossTerms blind = loss(at::log_softmax(at::randn({4, 21, 64, 64}), 1), batch.depth,
                               batch.labels, batch.rays, 1);
  // Occlusion and the unweighted pixel mean keep soft keypoints off the exposed centroids by
  // centimetres.
  EXPECT_LT(good.terms[1].item<double>(), 0.35);
  EXPECT_GT(blind.terms[1].item<double>(), 3 * good.terms[1].item<double>());
  EXPECT_EQ(good.degenerate.item<std::int64_t>(), 0);
}

TEST(TrainingLoss, LambdaRisesOverTheWarmUp) {
  const TrainingData data = SyntheticData(2, 32, 1000);
  const Batch batch = Collate(data.open_training(0)->Next());
  const at::Tensor log_probs = at::log_softmax(at::randn({2, 21, 32, 32}), 1);
  LossConfig config;
  config.lambda = 0.5;
  config.lambda_warmup_samples = 1000;
  const TrainingLoss loss(config, data.structure, at::kCPU);
  const std::vector<std::pair<int, double>> expected = {
      {0, 0.0}, {250, 0.125}, {1000, 0.5}, {9999, 0.5}};
  for (const auto& [samples, lambda] : expected) {
    const LossTerms t = loss(log_probs, batch.depth, batch.labels, batch.rays, samples);
    EXPECT_NEAR(t.total.item<double>(),
                t.terms[0].item<double>() + lambda * t.terms[1].item<double>(), 1e-6);
    EXPECT_GT(t.terms[1].item<double>(), 0);
  }
  config.procrustes = false;
  const LossTerms off = TrainingLoss(config, data.structure, at::kCPU)(
      log_probs, batch.depth, batch.labels, batch.rays, 9999);
  EXPECT_EQ(off.total.item<double>(), off.terms[0].item<double>());
  EXPECT_EQ(off.terms[1].item<double>(), 0);
}

/// The mean probability of the background.
class BackgroundTerm : public LossTerm {
 public:
  at::Tensor operator()(const LossInput& input) const override {
    return input.log_probs.select(1, 0).exp().mean();
  }
};

TEST(TrainingLoss, AddsRegisteredTerms) {
  const TrainingData data = SyntheticData(2, 32, 1000);
  const Batch batch = Collate(data.open_training(0)->Next());
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
    return std::make_unique<BackgroundTerm>();
  });
  EXPECT_THROW(RegisterLossTerm("background", nullptr), Error);
  const TrainingLoss loss(config, data.structure, at::kCPU);
  const LossTerms whole = loss(log_probs, batch.depth, batch.labels, batch.rays, 0);
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
    parts += loss(log_probs.narrow(0, i, 1), part.depth, part.labels, part.rays, 0, 0.5)
                 .total.item<double>();
  }
  EXPECT_NEAR(parts, whole.total.item<double>(), 1e-6);
  whole.total.backward();
  EXPECT_GT(log_probs.grad().select(1, 0).abs().sum().item<double>(), 0);
}

}  // namespace
}  // namespace volalign::losses_test

#include "train/optimizer.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/ones.h>
#include <ATen/ops/rand.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "tests/train/tiny_net.h"

namespace volalign::optimizer_test {
namespace {

/// Values on both sides of where the decay ends and of where a step's pieces meet.
std::vector<std::int64_t> Watched(FlatModule& flat) {
  const std::int64_t piece = 32768, weights = flat.num_weights(), n = flat.parameters().numel();
  EXPECT_GT(weights, piece);
  return {0, piece - 1, piece, weights - 1, weights, n - 1};
}

TEST(Adam, AgreesWithTheScalarAlgorithm) {
  for (const OptimizerKind kind : {OptimizerKind::kAdam, OptimizerKind::kAdamW}) {
    for (const auto& [decay, clip] :
         std::vector<std::pair<double, double>>{{0, 0}, {0, 0.3}, {0.1, 0}, {0.1, 0.3}}) {
      StructureNet net = TinyNet();
      FlatModule flat(*net);
      OptimConfig config;
      config.optimizer = kind;
      config.weight_decay = decay;
      config.clip_norm = clip;
      Optimizer adam(config, &flat);
      const std::int64_t n = flat.parameters().numel();
      const std::vector<std::int64_t> watched = Watched(flat);
      std::vector<double> p, m(watched.size(), 0.0), v(watched.size(), 0.0);
      for (std::int64_t i : watched) p.push_back(flat.parameters()[i].item<double>());
      for (int step = 1; step <= 5; ++step) {
        const at::Tensor g = at::rand({n}) - 0.5;
        flat.gradients().copy_(g);
        const double norm = std::sqrt(g.to(at::kDouble).square().sum().item<double>());
        const double lr = 0.01 / step;
        adam.Step(lr, adam.GradientNorm());
        EXPECT_EQ(flat.gradients().abs().max().item<double>(), 0);
        const double scale = clip > 0 ? std::min(1.0, clip / norm) : 1.0;
        for (std::size_t i = 0; i < watched.size(); ++i) {
          // Kingma and Ba 2015, algorithm 1; Loshchilov and Hutter 2019, algorithm 2, both ways.
          double gi = scale * g[watched[i]].item<double>();
          const bool weight = watched[i] < flat.num_weights();
          if (weight && kind == OptimizerKind::kAdam) gi += decay * p[i];
          m[i] = 0.9 * m[i] + 0.1 * gi;
          v[i] = 0.99 * v[i] + 0.01 * gi * gi;
          if (weight && kind == OptimizerKind::kAdamW) p[i] -= lr * decay * p[i];
          p[i] -= lr * (m[i] / (1 - std::pow(0.9, step))) /
                  (std::sqrt(v[i] / (1 - std::pow(0.99, step))) + 1e-8);
          EXPECT_NEAR(flat.parameters()[watched[i]].item<double>(), p[i], 2e-6) << step << " " << i;
        }
      }
    }
  }
}

TEST(Optimizer, LeavesWhatLiesBetweenTheParametersAtZero) {
  StructureNet net = TinyNet(Normalization::kBatch);
  FlatModule flat(*net);
  at::Tensor between = at::ones({flat.parameters().numel()});
  for (std::size_t i = 0; i < flat.tensors().size(); ++i)
    between.narrow(0, flat.offset(i), flat.tensors()[i].numel()).zero_();
  EXPECT_GT(between.sum().item<double>(), 0);
  OptimConfig config;
  config.optimizer = OptimizerKind::kAdamW;
  config.weight_decay = 0.1;
  Optimizer adam(config, &flat);
  for (int step = 0; step < 3; ++step) {
    net->forward(at::rand({2, 1, 16, 16})).square().sum().backward();
    adam.Step(0.1, adam.GradientNorm());
  }
  EXPECT_EQ((flat.parameters() * between).abs().max().item<double>(), 0);
}

TEST(WeightAverage, IsARunningMeanWhoseDecayRises) {
  StructureNet net = TinyNet(Normalization::kBatch);
  FlatModule source(*net);
  WeightAverage average(TinyNet(Normalization::kBatch), 0.5, source);
  const auto weight = [&] { return average.net()->parameters()[0].flatten()[0].item<double>(); };
  const auto statistic = [&] { return average.net()->buffers()[0].flatten()[0].item<double>(); };
  const auto fill = [&](double value) {
    source.parameters().fill_(value);
    source.buffers().fill_(value);
  };
  fill(0);
  average.Reset(source);
  fill(11);
  average.Update(source, 1);  // decay (1 + 1) / (10 + 1)
  EXPECT_NEAR(weight(), 9, 1e-5);
  EXPECT_NEAR(statistic(), 9, 1e-5);
  average.Update(source, 1000);  // decay 0.5, the largest
  EXPECT_NEAR(weight(), 10, 1e-5);
  average.Refresh(source);  // nothing, with a decay
  EXPECT_NEAR(weight(), 10, 1e-5);
}

TEST(WeightAverage, WithoutDecayIsTheWeightsOnceTheyAreAskedFor) {
  StructureNet net = TinyNet();
  FlatModule source(*net);
  WeightAverage average(TinyNet(), 0, source);
  const auto weight = [&] { return average.net()->parameters()[0].flatten()[0].item<double>(); };
  const double before = weight();
  source.parameters().fill_(7);
  average.Update(source, 1);
  EXPECT_EQ(weight(), before);
  average.Refresh(source);
  EXPECT_EQ(weight(), 7);
}

TEST(LearningRate, FollowsTheSchedule) {
  OptimConfig config;
  config.lr = 1e-3;
  EXPECT_EQ(LearningRate(config, 0, 1000), 1e-3);
  EXPECT_EQ(LearningRate(config, 999, 1000), 1e-3);
  config.schedule = Schedule::kOneCycle;
  config.warmup_samples = 99;
  EXPECT_NEAR(LearningRate(config, 0, 1099), 1e-5, 1e-12);
  EXPECT_NEAR(LearningRate(config, 49, 1099), 5e-4, 1e-12);
  EXPECT_NEAR(LearningRate(config, 99, 1099), 1e-3, 1e-12);
  EXPECT_NEAR(LearningRate(config, 599, 1099), 5e-4, 1e-12);
  EXPECT_NEAR(LearningRate(config, 1099, 1099), 0, 1e-12);
  EXPECT_NEAR(LearningRate(config, 5000, 1099), 0, 1e-12);
}

}  // namespace
}  // namespace volalign::optimizer_test

#include "train/optimizer.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/rand.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/network.h"

namespace volalign {
namespace {

StructureNet TinyNet(Normalization normalization = Normalization::kNone) {
  StructureNetOptions options;
  options.base_channels = 1;
  options.num_classes = 3;
  options.residual_blocks = 1;
  options.normalization = normalization;
  return StructureNet(options);
}

TEST(FlatModule, KeepsValuesAndCollectsGradients) {
  StructureNet net = TinyNet(Normalization::kBatch);
  std::map<std::string, at::Tensor> before;
  for (const auto& p : net->named_parameters()) before[p.key()] = p.value().detach().clone();
  FlatModule flat(*net);
  EXPECT_EQ(flat.parameters().numel(), CountParameters(*net));
  std::map<std::string, at::Tensor> views;
  flat.AddViews(flat.parameters(), "x/", &views);
  ASSERT_EQ(views.size(), before.size());
  for (const auto& [name, value] : before) EXPECT_TRUE(views.at("x/" + name).equal(value)) << name;

  net->forward(at::rand({2, 1, 16, 16})).square().sum().backward();
  double squares = 0;
  for (const at::Tensor& p : net->parameters()) squares += p.grad().square().sum().item<double>();
  EXPECT_GT(squares, 0);
  EXPECT_NEAR(flat.gradients().square().sum().item<double>() / squares, 1, 1e-5);
  const at::Tensor mean = net->named_buffers()["encoder1_1.running_mean"];
  EXPECT_NE(mean.abs().max().item<double>(), 0);  // the statistics moved with the forward pass
  flat.buffers().fill_(7);
  EXPECT_EQ(mean[0].item<double>(), 7);
}

TEST(Adam, AgreesWithTheScalarAlgorithm) {
  for (const bool decay : {false, true}) {
    for (const double clip : {0.0, 0.3}) {
      StructureNet net = TinyNet();
      FlatModule flat(*net);
      OptimConfig config;
      config.optimizer = decay ? "adamw" : "adam";
      config.weight_decay = decay ? 0.1 : 0;
      config.clip_norm = clip;
      Adam adam(config, &flat);
      const std::int64_t n = flat.parameters().numel();
      const std::vector<std::int64_t> watched = {0, flat.num_weights() - 1, flat.num_weights(),
                                                 n - 1};
      std::vector<double> p, m(4, 0.0), v(4, 0.0);
      for (std::int64_t i : watched) p.push_back(flat.parameters()[i].item<double>());
      for (int step = 1; step <= 5; ++step) {
        const at::Tensor g = at::rand({n}) - 0.5;
        flat.gradients().copy_(g);
        const double norm = std::sqrt(g.to(at::kDouble).square().sum().item<double>());
        const double lr = 0.01 / step;
        adam.Step(lr, adam.GradientNorm());
        EXPECT_EQ(flat.gradients().abs().max().item<double>(), 0);
        const double scale = clip > 0 ? std::min(1.0, clip / norm) : 1.0;
        for (std::size_t i = 0; i < 4; ++i) {
          // Kingma and Ba 2015, algorithm 1; Loshchilov and Hutter 2019, algorithm 2.
          const double gi = scale * g[watched[i]].item<double>();
          m[i] = 0.9 * m[i] + 0.1 * gi;
          v[i] = 0.99 * v[i] + 0.01 * gi * gi;
          if (decay && watched[i] < flat.num_weights()) p[i] -= lr * 0.1 * p[i];
          p[i] -= lr * (m[i] / (1 - std::pow(0.9, step))) /
                  (std::sqrt(v[i] / (1 - std::pow(0.99, step))) + 1e-8);
          EXPECT_NEAR(flat.parameters()[watched[i]].item<double>(), p[i], 2e-6) << step << " " << i;
        }
      }
    }
  }
}

TEST(LearningRate, FollowsTheSchedule) {
  OptimConfig config;
  config.lr = 1e-3;
  EXPECT_EQ(LearningRate(config, 0, 1000), 1e-3);
  EXPECT_EQ(LearningRate(config, 999, 1000), 1e-3);
  config.schedule = "one_cycle";
  config.warmup_samples = 99;
  EXPECT_NEAR(LearningRate(config, 0, 1099), 1e-5, 1e-12);
  EXPECT_NEAR(LearningRate(config, 49, 1099), 5e-4, 1e-12);
  EXPECT_NEAR(LearningRate(config, 99, 1099), 1e-3, 1e-12);
  EXPECT_NEAR(LearningRate(config, 599, 1099), 5e-4, 1e-12);
  EXPECT_NEAR(LearningRate(config, 1099, 1099), 0, 1e-12);
  EXPECT_NEAR(LearningRate(config, 5000, 1099), 0, 1e-12);
}

}  // namespace
}  // namespace volalign

#include "train/optimizer.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/cat.h>
#include <ATen/ops/full.h>
#include <ATen/ops/ones.h>
#include <ATen/ops/rand.h>
#include <ATen/ops/zeros.h>
#include <gtest/gtest.h>
#include <torch/optim/adam.h>
#include <torch/optim/adamw.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "tests/train/tiny_net.h"

namespace volalign::optimizer_test {
namespace {

/// LibTorch's, of values that decay and of others that do not.
template <class Adam, class Options>
std::unique_ptr<torch::optim::Optimizer> Reference(const std::vector<at::Tensor>& values,
                                                   double decay) {
  std::vector<torch::optim::OptimizerParamGroup> groups;
  for (const at::Tensor& part : values) {
    Options options;
    options.betas({0.9, 0.99}).weight_decay(groups.empty() ? decay : 0);
    groups.emplace_back(std::vector<at::Tensor>{part}, std::make_unique<Options>(options));
  }
  return std::make_unique<Adam>(groups, Options());
}

TEST(Adam, IsLibTorchs) {
  using namespace torch::optim;
  for (const std::string kind : {"adam", "adamw"}) {
    for (const auto& [decay, clip] :
         std::vector<std::pair<double, double>>{{0, 0}, {0, 0.3}, {0.1, 0}, {0.1, 0.3}}) {
      StructureNet net = TinyNet();
      FlatModule flat(*net);
      OptimConfig config;
      config.optimizer = kind;
      config.weight_decay = decay;
      config.clip_norm = clip;
      volalign::Optimizer adam(config, &flat);
      const std::int64_t n = flat.parameters().numel(), weights = flat.num_weights();
      EXPECT_GT(weights, 32768) << "a step takes several pieces";
      const std::vector<at::Tensor> values =
          flat.parameters().detach().clone().split_with_sizes({weights, n - weights});
      const auto reference = kind == "adam" ? Reference<Adam, AdamOptions>(values, decay)
                                            : Reference<AdamW, AdamWOptions>(values, decay);
      for (int step = 1; step <= 5; ++step) {
        const at::Tensor g = at::rand({n}) - 0.5;
        flat.gradients().copy_(g);
        const double lr = 0.01 / step, norm = g.norm().item<double>();
        adam.Step(lr, adam.GradientNorm());
        EXPECT_EQ(flat.gradients().abs().max().item<double>(), 0);
        const at::Tensor clipped = g * (clip > 0 ? std::min(1.0, clip / norm) : 1.0);
        for (std::size_t i = 0; i < 2; ++i) {
          values[i].mutable_grad() = clipped.split_with_sizes({weights, n - weights})[i];
          reference->param_groups()[i].options().set_lr(lr);
        }
        reference->step();
        EXPECT_LT((flat.parameters() - at::cat(values)).abs().max().item<double>(), 2e-6) << step;
      }
    }
  }
}

TEST(Optimizer, LeavesWhatLiesBetweenTheParametersAtZero) {
  StructureNet net = TinyNet(Normalization::kBatch);
  FlatModule flat(*net);
  at::Tensor between = at::ones({flat.parameters().numel()});
  std::map<std::string, at::Tensor> parameters;
  flat.AddViews(between, "", &parameters);
  for (auto& [name, view] : parameters) view.zero_();
  EXPECT_GT(between.sum().item<double>(), 0);
  OptimConfig config;
  config.optimizer = "adamw";
  config.weight_decay = 0.1;
  Optimizer adam(config, &flat);
  for (int step = 0; step < 3; ++step) {
    net->forward(at::rand({2, 1, 16, 16})).square().sum().backward();
    adam.Step(0.1, adam.GradientNorm());
  }
  EXPECT_EQ((flat.parameters() * between).abs().max().item<double>(), 0);
}

TEST(RegisterOptimizer, AddsARuleWithWhatItKeeps) {
  RegisterOptimizer("heavy_ball", {"velocity"}, [](OptimizerStep& step) {
    at::Tensor& velocity = step.moments[0];
    velocity.mul_(step.beta1).add_(step.gradient).add_(step.weights, step.weight_decay);
    step.weights.sub_(velocity, step.lr * static_cast<double>(step.number));
  });
  EXPECT_THROW(RegisterOptimizer("heavy_ball", {}, nullptr), Error);
  EXPECT_THROW(RegisterOptimizer("adam", {}, nullptr), Error);
  EXPECT_EQ(OptimizerNames(), (std::vector<std::string>{"adam", "adamw", "heavy_ball"}));
  StructureNet net = TinyNet();
  FlatModule flat(*net);
  OptimConfig config;
  config.optimizer = "heavy_ball";
  config.weight_decay = 0.1;
  config.clip_norm = 0.5;
  Optimizer optimizer(config, &flat);
  const std::int64_t n = flat.parameters().numel(), weights = flat.num_weights();
  const at::Tensor decay = at::cat({at::full({weights}, 0.1), at::zeros({n - weights})});
  at::Tensor values = flat.parameters().detach().clone(), velocity = at::zeros({n});
  for (int step = 1; step <= 3; ++step) {
    const at::Tensor g = at::rand({n}) - 0.5;
    flat.gradients().copy_(g);
    optimizer.Step(0.01, optimizer.GradientNorm());
    velocity = 0.9 * velocity + 0.5 * g / g.norm() + decay * values;
    values = values - 0.01 * step * velocity;
    EXPECT_LT((flat.parameters() - values).abs().max().item<double>(), 2e-6) << step;
  }
  EXPECT_EQ(optimizer.moments().front().first, "velocity");
  config.optimizer = "sgd";
  EXPECT_THROW(Optimizer(config, &flat), ConfigError);
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

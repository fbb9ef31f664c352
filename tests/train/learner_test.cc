#include "train/learner.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/full.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include <string>

#include "core/base/error.h"
#include "core/nn/checkpoint.h"
#include "tests/core/base/temp_folder.h"
#include "tests/train/watched_memory.h"

namespace volalign::learner_test {
namespace {

TrainConfig SmallConfig(std::int64_t seed = 1) {
  TrainConfig config;
  config.model.base_channels = 1;
  config.model.residual_blocks = 1;
  config.optim.ema_decay = 0.9;
  config.run.seed = seed;
  return config;
}

at::Tensor Average(Learner& learner) { return learner.average.net()->parameters()[0].flatten(); }

TEST(Learner, IsDrawnWithTheRunsSeedAndAveragedFromThereOn) {
  const Compute compute;
  Learner a(SmallConfig(), 3, compute), b(SmallConfig(), 3, compute), c(SmallConfig(2), 3, compute);
  EXPECT_TRUE(a.flat.parameters().equal(b.flat.parameters()));
  EXPECT_FALSE(a.flat.parameters().equal(c.flat.parameters()));
  EXPECT_TRUE(Average(a).equal(a.net->parameters()[0].detach().flatten()));
}

TEST(Learner, AnUpdateStepsTheWeightsAndTheirAverage) {
  Learner learner(SmallConfig(), 3, Compute());
  const at::Tensor before = learner.flat.parameters().clone();
  const double average = Average(learner)[0].item<double>();
  const double start = learner.net->parameters()[0].flatten()[0].item<double>();
  learner.flat.gradients().fill_(1);
  const auto norm = [&] { return learner.optimizer.GradientNorm(); };
  learner.Update(0.25, norm(), at::full({}, true, at::kBool));
  EXPECT_LT((learner.flat.parameters() - (before - 0.25)).abs().max().item<double>(), 1e-6);
  EXPECT_EQ(learner.flat.gradients().abs().max().item<double>(), 0);
  EXPECT_EQ(learner.optimizer.steps(), 1);
  // The decay of the first step is 2 / 11 (train/averaging.cc).
  EXPECT_EQ(average, start);
  EXPECT_NEAR(Average(learner)[0].item<double>(), start - 0.25 * 9 / 11, 1e-6);
}

/// Weights, moments and average of a step that is to be skipped stay; one that is not is the same
/// whether the host knows.
TEST(Learner, SkipsAStepThatIsNotFinite) {
  TrainConfig config = SmallConfig();
  config.optim.optimizer = OptimizerKind::kAdam;
  config.optim.clip_norm = 1;
  Learner seen(config, 3, Compute()), unseen(config, 3, Compute());
  const auto state = [](Learner& l) {
    std::vector<at::Tensor> all = {l.flat.parameters().clone()};
    for (const auto& [name, moment] : l.optimizer.moments()) all.push_back(moment.clone());
    for (const at::Tensor& values : l.average.net()->parameters()) all.push_back(values.clone());
    return all;
  };
  const auto equal = [](const std::vector<at::Tensor>& a, const std::vector<at::Tensor>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                      [](const at::Tensor& x, const at::Tensor& y) { return x.equal(y); });
  };
  const auto step = [&](float gradient, bool finite) {
    for (Learner* l : {&seen, &unseen}) {
      l->flat.gradients().fill_(gradient);
      const at::Tensor norm = l->optimizer.GradientNorm(), good = at::full({}, finite, at::kBool);
      if (l == &seen) {
        l->Update(0.1, norm, good);
      } else {
        l->UpdateUnseen(0.1, norm, good);
      }
      EXPECT_EQ(l->flat.gradients().abs().max().item<double>(), 0);
    }
  };
  const std::vector<at::Tensor> start = state(seen);
  step(1, true);
  const std::vector<at::Tensor> once = state(seen);
  EXPECT_FALSE(equal(once, start));
  EXPECT_TRUE(equal(state(unseen), once));
  step(NAN, false);
  EXPECT_TRUE(equal(state(seen), once));
  EXPECT_TRUE(equal(state(unseen), once));
  EXPECT_EQ(seen.optimizer.steps(), 1);
}

// A copy of everything would be 0.8 GB at the paper's width.
TEST(Learner, CopiesAPieceAtATimeOfWhatItMayTakeBack) {
  TrainConfig config = SmallConfig();
  config.model.base_channels = 16;
  config.optim.optimizer = OptimizerKind::kAdam;
  Learner learner(config, 3, Compute());
  const std::size_t all = learner.flat.parameters().nbytes();
  const at::Tensor norm = learner.optimizer.GradientNorm(), good = at::full({}, true, at::kBool);
  std::size_t asked = 0;
  const WatchedMemory memory([&](std::size_t bytes) { asked = std::max(asked, bytes); });
  learner.UpdateUnseen(0.1, norm, good);
  EXPECT_GT(asked, 0U);
  EXPECT_LT(asked, all / 2);
}

class StartFromTest : public testing::Test {
 protected:
  StartFromTest() {
    Learner trained(SmallConfig(5), structure_.num_classes(), Compute());
    CheckpointMeta meta;
    meta.network = trained.net->options();
    meta.structure = structure_;
    meta.samples = 1234;
    SaveCheckpoint(path_, trained.net, meta, false);
    weights_ = trained.flat.parameters().clone();
  }

  Structure structure_ = ReadStructure("configs/structure.yaml");
  TempFolder folder_;
  std::string path_ = (folder_ / "model.safetensors").string();
  at::Tensor weights_;
};

TEST_F(StartFromTest, TakesOverTheWeightsInTrainingAndInTheAverage) {
  Learner learner(SmallConfig(), structure_.num_classes(), Compute());
  EXPECT_EQ(StartFrom(path_, structure_, &learner), 1234);
  EXPECT_TRUE(learner.flat.parameters().equal(weights_));
  EXPECT_TRUE(Average(learner).equal(learner.net->parameters()[0].detach().flatten()));
}

TEST_F(StartFromTest, RefusesAnotherNetworkAndOtherLabels) {
  TrainConfig wider = SmallConfig();
  wider.model.base_channels = 2;
  Learner other(wider, structure_.num_classes(), Compute());
  EXPECT_THROW(StartFrom(path_, structure_, &other), ConfigError);
  Learner learner(SmallConfig(), structure_.num_classes(), Compute());
  const at::Tensor before = learner.flat.parameters().clone();
  const Structure one =
      Structure::FromBoxes("one", {Box::FromMinMax("box", {-0.2, -0.4, -0.2}, {0.2, 0, 0.2})});
  EXPECT_THROW(StartFrom(path_, one, &learner), DataError);
  EXPECT_TRUE(learner.flat.parameters().equal(before));
}

}  // namespace
}  // namespace volalign::learner_test

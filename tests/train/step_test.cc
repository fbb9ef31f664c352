#include "train/step.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/full.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/nn/checkpoint.h"
#include "tests/core/base/temp_folder.h"
#include "tests/train/synthetic_source.h"
#include "tests/train/watched_memory.h"
#include "train/train_state.h"

namespace volalign::step_test {
namespace {

/// A batch in parts has the gradient and the losses of the whole one.
TEST(ComputeGradient, OfPartsAddsUpToThatOfTheBatch) {
  const TrainingData data = SyntheticData(5, 32, 1u << 20);
  Batch batch = Collate(data.open_training(0)());
  // Where neighbours are equal, rounding decides which of them the pooling takes the gradient to.
  batch.depth += 0.02 * at::rand(batch.depth.sizes(), at::detail::createCPUGenerator(1));
  TrainConfig config;
  config.model.base_channels = 2;
  config.model.residual_blocks = 1;
  config.model.normalization = Normalization::kGroup;
  const Compute compute;
  const TrainingLoss loss(config.loss, data.structure, at::kCPU);
  at::Tensor expected;
  StepReport whole;
  for (const int micro_batch : {0, 1, 2}) {
    TrainState state(config, data.structure.num_classes(), compute);
    const StepNumbers numbers = ComputeGradient(state, loss, batch, compute, 0, micro_batch);
    const StepReport report = ReadSums(numbers.Sums(), loss.names());
    EXPECT_EQ(report.steps, 1);
    EXPECT_EQ(report.skipped, 0);
    EXPECT_NEAR(numbers.norm.item<double>(), report.gradient_norm, 1e-12);
    const at::Tensor gradient = state.flat.gradients().clone();
    if (micro_batch == 0) {
      expected = gradient;
      whole = report;
      EXPECT_GT(report.terms.at("loss_3d"), 0);
      continue;
    }
    SCOPED_TRACE(micro_batch);
    EXPECT_LT((gradient - expected).norm().item<double>(), 1e-4 * expected.norm().item<double>());
    EXPECT_NEAR(report.loss, whole.loss, 1e-5 * whole.loss);
    EXPECT_NEAR(report.terms.at("loss_seg"), whole.terms.at("loss_seg"),
                1e-5 * whole.terms.at("loss_seg"));
    EXPECT_NEAR(report.terms.at("loss_3d"), whole.terms.at("loss_3d"),
                1e-5 * whole.terms.at("loss_3d"));
    EXPECT_EQ(report.degenerate_samples, whole.degenerate_samples);
  }
}

TEST(StepNumbers, OfAStepThatIsNotFiniteCountAsNothing) {
  const auto numbers = [](double loss, bool finite) {
    StepNumbers n;
    n.values = at::full({5}, loss, at::kDouble);
    n.finite = at::full({}, finite, at::kBool);
    return n;
  };
  const StepReport sum = ReadSums(numbers(2, true).Sums() + numbers(NAN, false).Sums() +
                                      numbers(INFINITY, false).Sums() + numbers(3, true).Sums(),
                                  {"loss_seg", "loss_3d"});
  EXPECT_EQ(sum.steps, 4);
  EXPECT_EQ(sum.skipped, 2);
  EXPECT_EQ(sum.loss, 5);
  EXPECT_EQ(sum.degenerate_samples, 5);
  EXPECT_EQ(sum.gradient_norm, 5);
}

TEST(Compute, AutoIsDecidedByTheDevice) {
  const at::Device cpu(at::kCPU), cuda("cuda:1");
  RunConfig run;
  run.precision = Precision::kAuto;
  run.channels_last = Layout::kAuto;
  for (const bool processor : {false, true}) {
    for (const bool device : {false, true}) {
      const Compute here = DecideCompute(run, cpu, {processor, device}),
                    there = DecideCompute(run, cuda, {processor, device});
      EXPECT_EQ(here.type, processor ? at::kBFloat16 : at::kFloat);
      EXPECT_TRUE(here.channels_last);
      EXPECT_EQ(there.type, device ? at::kBFloat16 : at::kFloat);
      EXPECT_EQ(there.channels_last, device);
      EXPECT_EQ(there.device, cuda);
    }
  }
  run.precision = Precision::kFp32;  // what is said holds
  EXPECT_EQ(DecideCompute(run, cuda, {true, true}).type, at::kFloat);
  EXPECT_FALSE(DecideCompute(run, cuda, {true, true}).channels_last);
  run.channels_last = Layout::kChannelsLast;
  EXPECT_TRUE(DecideCompute(run, cuda, {false, false}).channels_last);
}

TEST(IdleProcessors, AreThoseThatNobodyUsed) {
  // user nice system idle iowait irq softirq steal guest
  const std::string before =
      "cpu  100 0 100 1000 0 0 0 0 50\ncpu0 50 0 50 500 0 0 0 0 50\ncpu1 50 0 50 500 0 0 0 0 0\n"
      "cpu2 0 0 0 0 0 0 0 0 0\ncpu3 0 0 0 0 0 0 0 0 0\nintr 1 2 3\n";
  const auto after = [](int busy, int idle) {
    return fmt::format("cpu  {} 0 100 {} 0 0 0 0 50\ncpu0\ncpu1\ncpu2\ncpu3\n", 100 + busy,
                       1000 + idle);
  };
  EXPECT_EQ(IdleProcessors(before, after(0, 80), 4), 4);
  EXPECT_EQ(IdleProcessors(before, after(7, 73), 4), 4);
  EXPECT_EQ(IdleProcessors(before, after(60, 20), 4), 1);
  EXPECT_EQ(IdleProcessors(before, after(80, 0), 4), 1);
  EXPECT_EQ(IdleProcessors(before, after(0, 80), 2), 2) << "a process that may use two";
  EXPECT_THROW(IdleProcessors("", "", 4), DataError);
  EXPECT_EQ(WithinQuota("150000 100000\n", 64), 2);
  EXPECT_EQ(WithinQuota("max 100000\n", 64), 64);
  EXPECT_EQ(WithinQuota("10000 100000\n", 64), 1);
  EXPECT_GE(IdleProcessors(), 1);
}

// Slurm with --gpus-per-task=1 shows each process one device, which is number 0 to it.
TEST(Compute, OfSeveralProcessesEachTakesADeviceThatItSees) {
  World world;
  world.size = 4;
  world.local_rank = 3;
  const at::Device cuda(at::kCUDA);
  EXPECT_EQ(DeviceOf(cuda, world, 4).index(), 3);
  EXPECT_EQ(DeviceOf(cuda, world, 1).index(), 0);
  EXPECT_EQ(DeviceOf(cuda, world, 2).index(), 1);
  EXPECT_EQ(DeviceOf(at::Device("cuda:2"), world, 4).index(), 2);
  EXPECT_FALSE(DeviceOf(cuda, World(), 4).has_index());
  EXPECT_TRUE(DeviceOf(at::kCPU, world, 0).is_cpu());
}

TEST(Compute, AutoIsBf16WhereTheKernelListsIt) {
  std::ifstream info("/proc/cpuinfo");
  bool listed = false;
  for (std::string word; info >> word;) listed |= word == "avx512_bf16" || word == "bf16";
  EXPECT_EQ(ProcessorHasBf16(), listed);
  RunConfig run;
  EXPECT_EQ(ChooseCompute(run).type, at::kFloat);
  EXPECT_FALSE(ChooseCompute(run).channels_last);
  run.precision = Precision::kAuto;
  run.channels_last = Layout::kAuto;
  EXPECT_EQ(ChooseCompute(run).type, listed ? at::kBFloat16 : at::kFloat);
  EXPECT_TRUE(ChooseCompute(run).channels_last);
}

TrainConfig SmallConfig(std::int64_t seed = 1) {
  TrainConfig config;
  config.model.base_channels = 1;
  config.model.residual_blocks = 1;
  config.optim.ema_decay = 0.9;
  config.run.seed = seed;
  return config;
}

at::Tensor Average(TrainState& state) { return state.average.net()->parameters()[0].flatten(); }

TEST(TrainState, IsDrawnWithTheRunsSeedAndAveragedFromThereOn) {
  const Compute compute;
  TrainState a(SmallConfig(), 3, compute), b(SmallConfig(), 3, compute),
      c(SmallConfig(2), 3, compute);
  EXPECT_TRUE(a.flat.parameters().equal(b.flat.parameters()));
  EXPECT_FALSE(a.flat.parameters().equal(c.flat.parameters()));
  EXPECT_TRUE(Average(a).equal(a.net->parameters()[0].detach().flatten()));
}

TEST(TrainState, AnUpdateStepsTheWeightsAndTheirAverage) {
  TrainState state(SmallConfig(), 3, Compute());
  const at::Tensor before = state.flat.parameters().clone();
  const double average = Average(state)[0].item<double>();
  const double start = state.net->parameters()[0].flatten()[0].item<double>();
  state.flat.gradients().fill_(1);
  const auto norm = [&] { return state.optimizer.GradientNorm(); };
  state.Update(0.25, norm(), at::full({}, true, at::kBool));
  EXPECT_LT((state.flat.parameters() - (before - 0.25)).abs().max().item<double>(), 1e-6);
  EXPECT_EQ(state.flat.gradients().abs().max().item<double>(), 0);
  EXPECT_EQ(state.optimizer.steps(), 1);
  // The decay of the first step is 2 / 11 (train/optimizer.cc).
  EXPECT_EQ(average, start);
  EXPECT_NEAR(Average(state)[0].item<double>(), start - 0.25 * 9 / 11, 1e-6);
}

/// Weights, moments and average of a step that is to be skipped stay; one that is not is the same
/// whether the host knows.
TEST(TrainState, SkipsAStepThatIsNotFinite) {
  TrainConfig config = SmallConfig();
  config.optim.clip_norm = 1;
  TrainState seen(config, 3, Compute()), unseen(config, 3, Compute());
  const auto state = [](TrainState& l) {
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
    for (TrainState* l : {&seen, &unseen}) {
      l->flat.gradients().fill_(gradient);
      const at::Tensor norm = l->optimizer.GradientNorm(), good = at::full({}, finite, at::kBool);
      if (l == &seen) {
        l->Update(0.1, norm, good);
      } else {
        l->Step(0.1, norm, good);
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
TEST(TrainState, CopiesAPieceAtATimeOfWhatItMayTakeBack) {
  TrainConfig config = SmallConfig();
  config.model.base_channels = 16;
  TrainState state(config, 3, Compute());
  const std::size_t all = state.flat.parameters().nbytes();
  const at::Tensor norm = state.optimizer.GradientNorm(), good = at::full({}, true, at::kBool);
  std::size_t asked = 0;
  const WatchedMemory memory([&](std::size_t bytes) { asked = std::max(asked, bytes); });
  state.Step(0.1, norm, good);
  EXPECT_GT(asked, 0U);
  EXPECT_LT(asked, all / 2);
}

class StartFromTest : public testing::Test {
 protected:
  StartFromTest() {
    TrainState trained(SmallConfig(5), structure_.num_classes(), Compute());
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
  TrainState state(SmallConfig(), structure_.num_classes(), Compute());
  EXPECT_EQ(StartFrom(path_, structure_, &state), 1234);
  EXPECT_TRUE(state.flat.parameters().equal(weights_));
  EXPECT_TRUE(Average(state).equal(state.net->parameters()[0].detach().flatten()));
}

TEST_F(StartFromTest, RefusesAnotherNetworkAndOtherLabels) {
  TrainConfig wider = SmallConfig();
  wider.model.base_channels = 2;
  TrainState other(wider, structure_.num_classes(), Compute());
  EXPECT_THROW(StartFrom(path_, structure_, &other), ConfigError);
  TrainState state(SmallConfig(), structure_.num_classes(), Compute());
  const at::Tensor before = state.flat.parameters().clone();
  const Structure one =
      Structure::FromBoxes("one", {Box::FromMinMax("box", {-0.2, -0.4, -0.2}, {0.2, 0, 0.2})});
  EXPECT_THROW(StartFrom(path_, one, &state), DataError);
  EXPECT_TRUE(state.flat.parameters().equal(before));
}

}  // namespace
}  // namespace volalign::step_test

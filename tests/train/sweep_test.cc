#include "train/sweep.h"

#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/interrupt.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "train/log/run_log.h"

namespace volalign::sweep_test {
namespace {

Sweep Read(const std::string& yaml) { return ReadSweep(ConfigSource::FromString(yaml, "sweep")); }

TEST(Sweep, HasEveryCombination) {
  const Sweep sweep = Read(
      "recipes: [configs/m04.yaml, configs/m05.yaml]\n"
      "set: {optim.lr: [1e-4, 2e-4], loss.lambda: 0.2, data.image_sizes: '[40x36, 64x36]'}\n"
      "seeds: [3, 4]\n");
  const std::vector<SweepRun> runs = ExpandSweep(sweep, {"run.batch_size=8"});
  ASSERT_EQ(runs.size(), 8u);
  EXPECT_EQ(runs[0].name, "m04_optim.lr=1e-4_run.seed=3");
  EXPECT_EQ(runs[7].name, "m05_optim.lr=2e-4_run.seed=4");
  EXPECT_EQ(runs[7].config.optim.lr, 2e-4);
  EXPECT_EQ(runs[7].config.run.seed, 4);
  EXPECT_TRUE(runs[7].config.loss.procrustes);
  EXPECT_FALSE(runs[0].config.loss.procrustes);
  for (const SweepRun& run : runs) {
    EXPECT_EQ(run.config.loss.lambda, 0.2);
    EXPECT_EQ(run.config.run.batch_size, 8);
    EXPECT_EQ(run.config.data.image_sizes, (std::vector<std::string>{"40x36", "64x36"}));
  }
  // --set goes before what the file has for all runs, and may not take the place of a list.
  EXPECT_EQ(ExpandSweep(sweep, {"loss.lambda=0.3"})[0].config.loss.lambda, 0.3);
  ExpectError<ConfigError>([&] { ExpandSweep(sweep, {"optim.lr=1e-3"}); }, {"optim.lr", "several"});
  // Whoever adds a value or a seed later finds the earlier runs in the same folders.
  EXPECT_EQ(ExpandSweep(Read("recipes: [configs/m04.yaml]\nseeds: [3]\n"), {}).at(0).name,
            "m04_run.seed=3");
}

TEST(Sweep, SetsARecipeOverAllOthers) {
  const SweepRun run = ExpandSweep(
      Read("recipes: [configs/m03.yaml]\nover: configs/lite.yaml\nset: {run.samples: 7}\n"),
      {"run.batch_size=3"})[0];
  EXPECT_EQ(run.name, "m03");
  EXPECT_TRUE(run.config.loss.procrustes);
  EXPECT_EQ(run.config.model.base_channels, 8);
  EXPECT_EQ(run.config.data.image_sizes, (std::vector<std::string>{"160x144", "160x90"}));
  EXPECT_EQ(run.config.run.samples, 7);
  EXPECT_EQ(run.config.run.batch_size, 3);
}

TEST(Sweep, SaysWhatIsWrong) {
  ExpectError<ConfigError>([] { Read("seeds: [1]\n"); }, {"recipes"});
  ExpectError<ConfigError>([] { Read("recipes: [a.yaml]\nseed: [1]\n"); }, {"seed", "sweep:2"});
  ExpectError<ConfigError>(
      [] { ExpandSweep(Read("recipes: [configs/m04.yaml]\nset: {optim.lrr: [1]}\n"), {}); },
      {"optim.lrr", "optim.lr"});
  ExpectError<ConfigError>(
      [] { ExpandSweep(Read("recipes: [configs/m04.yaml]\nseeds: [1, 1]\n"), {}); },
      {"m04_run.seed=1"});
}

TEST(Sweep, GoesOnWhereItStoppedAndPastAFailure) {
  const TempFolder folder;
  const std::vector<std::string> tiny = {"model.base_channels=2",
                                         "model.residual_blocks=1",
                                         "data.image_sizes=[40x36, 64x36]",
                                         "run.batch_size=2",
                                         "run.samples=4",
                                         "run.validation_samples=2",
                                         "run.threads=1",
                                         "optim.warmup_samples=2",
                                         "loss.min_side_pixels=3",
                                         "run.log_every=2",
                                         "run.checkpoint_every=1000",
                                         "run.tensorboard=false"};
  const auto runs = ExpandSweep(Read("recipes: [configs/m05-lite.yaml]\nseeds: [1, 2, 3]\n"), tiny);
  // The second folder holds a run of another configuration.
  auto other = runs[1];
  other.config.loss.lambda = 0.3;
  const std::string dir = folder.path().string();
  EXPECT_TRUE(TrainSweep({other}, dir, true).failures.empty());
  const SweepResult result = TrainSweep(runs, dir, true);
  EXPECT_TRUE(result.finished);
  ASSERT_EQ(result.failures.size(), 1u);
  EXPECT_NE(result.failures[0].find("loss.lambda"), std::string::npos) << result.failures[0];
  const std::string state =
      "m05-lite_run.seed=3/states/000000000004.state";  // written once, not again
  const auto written = std::filesystem::last_write_time(folder / state);
  EXPECT_TRUE(TrainSweep(runs, dir, true).finished);
  EXPECT_EQ(std::filesystem::last_write_time(folder / state), written);
  EXPECT_EQ(ReadRuns({dir}).size(), 3u);
}

// A signal that comes between two runs is noted by the guard of the whole sweep.
TEST(Sweep, BeginsNoRunAfterASignal) {
  const TempFolder folder;
  const auto runs = ExpandSweep(Read("recipes: [configs/m05-lite.yaml]\nseeds: [1, 2]\n"),
                                {"run.samples=5000", "run.threads=1"});
  const InterruptGuard guard;
  std::raise(SIGINT);
  const SweepResult result = TrainSweep(runs, (folder / "sweep").string(), true);
  EXPECT_EQ(result.signal, SIGINT);
  EXPECT_FALSE(result.finished);
  EXPECT_FALSE(std::filesystem::exists(folder / "sweep" / runs[0].name));
}

}  // namespace
}  // namespace volalign::sweep_test

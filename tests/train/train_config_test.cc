#include "train/train_config.h"

#include <gtest/gtest.h>

#include <array>
#include <csignal>
#include <filesystem>
#include <string>
#include <vector>

#include "core/base/interrupt.h"
#include "render/sample.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "train/log/run_log.h"
#include "train/sweep.h"

namespace volalign::train_config_test {
namespace {

TrainConfig Read(const std::string& path) { return ReadTrainConfig(ConfigSource::FromFile(path)); }

/// The keys of `yaml` have these values in the configuration: read over it, they change nothing.
void ExpectHas(const TrainConfig& config, const std::string& yaml) {
  const TrainConfig read = ReadConfig(ConfigSource::FromString(yaml, "expected"), config);
  EXPECT_EQ(WriteConfig(read), WriteConfig(config));
}

TEST(TrainConfig, PaperModelsAreThoseOfTheTable) {
  struct Row {  // paper, Results, table of models
    const char* name;
    bool attention, procrustes;
    double rho_max;
  };
  const std::vector<Row> table = {{"m01", false, false, 225}, {"m02", true, false, 225},
                                  {"m03", true, true, 225},   {"m04", true, false, 275},
                                  {"m05", true, true, 275},   {"m06", true, false, 350},
                                  {"m07", true, true, 350}};
  for (const Row& row : table) {
    SCOPED_TRACE(row.name);
    const TrainConfig c = Read(std::string("configs/") + row.name + ".yaml");
    EXPECT_EQ(c.model.attention, row.attention);
    EXPECT_EQ(c.loss.procrustes, row.procrustes);
    EXPECT_EQ(c.data.pose.rho_cm[0], 150);
    EXPECT_EQ(c.data.pose.rho_cm[1], row.rho_max);
    ExpectHas(c, R"(
data:
  pose: {height_cm: [-15, 75], look_at_radius_cm: 20, roll_deg: 5, roll_offsets_deg: [90]}
  image_sizes: [320x180]
  noise: {models: [paper]}
  scene: {room_probability: 1}
  sensors: [realsense_d415]
  assembly: {position_mm: 0, yaw_deg: 0, size_scale_percent: 0, floor_tilt_deg: 0}
model: {base_channels: 32, normalization: none, input: depth, residual_blocks: 4, background_bias: 0}
loss: {lambda: 0.1, lambda_warmup_samples: 0, min_side_pixels: 1, keypoints: centre}
optim: {optimizer: adam, lr: 2e-4, beta1: 0.9, beta2: 0.99, weight_decay: 5e-4, schedule: constant,
        clip_norm: 0, ema_decay: 0}
run: {batch_size: 16, samples: 3200000, precision: fp32, micro_batch: 0})");
  }
}

TEST(TrainConfig, LiteIsASmallM05) {
  ExpectHas(Read("configs/m05-lite.yaml"), R"(
data:
  pose: {rho_cm: [150, 275], roll_offsets_deg: [90]}
  noise: {models: [sensor]}
  assembly: {position_mm: 3, yaw_deg: 0.5, size_scale_percent: 1, floor_tilt_deg: 0.5}
model: {attention: true, base_channels: 8}
loss: {procrustes: true, keypoints: exposed})");
}

TEST(TrainConfig, ASmallRecipeIsComposedOfTwoFiles) {
  const TempFolder folder;
  const std::string configs = std::filesystem::absolute("configs").string();
  const TrainConfig c = Read(
      folder.Write("mine.yaml", "inherits: [" + configs + "/m06.yaml, " + configs + "/lite.yaml]\n")
          .string());
  ExpectHas(c, R"(
data: {pose: {rho_cm: [150, 350]}}
model: {attention: true, base_channels: 8, normalization: batch}
loss: {procrustes: false}
optim: {optimizer: adamw}
run: {samples: 20000})");
}

// The paper's predecessor differs from the shipped small recipe as m01 does from m05, and by where
// its sensors stand.
TEST(TrainConfig, FourViewStandsAtFourPlacements) {
  const TrainConfig c = Read("configs/paper/four_view.yaml"), lite = Read("configs/m05-lite.yaml");
  EXPECT_FALSE(c.model.attention);
  EXPECT_FALSE(c.loss.procrustes);
  EXPECT_EQ(c.data.pose.phi_deg, (std::vector<double>{45, 135, 225, 315}));
  EXPECT_EQ(c.data.pose.rho_cm, (std::array<double, 2>{175, 220}));
  EXPECT_EQ(c.model.base_channels, lite.model.base_channels);
  EXPECT_EQ(c.data.image_sizes, lite.data.image_sizes);
  EXPECT_TRUE(lite.data.pose.phi_deg.empty());
  EXPECT_NO_THROW(MakeSampleContext(c.data, 1));
}

TEST(TrainConfig, DefaultsAndRecipesDrawEverySensorThatTheyName) {
  EXPECT_NO_THROW(MakeSampleContext(SampleConfig(), 1));
  for (const char* name : {"m01", "m05-lite", "ablation"}) {
    const TrainConfig c = Read(std::string("configs/") + name + ".yaml");
    EXPECT_NO_THROW(MakeSampleContext(c.data, 1)) << name;
  }
}

TEST(TrainConfig, ReadsTheLayoutOfOlderRecipes) {
  ConfigSource source = ConfigSource::FromFile("configs/m01.yaml");
  source.Set("run.channels_last=true");
  EXPECT_EQ(ReadTrainConfig(source).run.channels_last, Layout::kChannelsLast);
}

/// The message of the ConfigError for m01 with one assignment.
std::string SetError(const std::string& assignment, const std::string& part = "") {
  SCOPED_TRACE(assignment);
  ConfigSource source = ConfigSource::FromFile("configs/m01.yaml");
  source.Set(assignment);
  return ExpectError<ConfigError>([&] { ReadTrainConfig(source); }, {part});
}

// Every saved configuration of earlier versions has them.
TEST(TrainConfig, KeysThatAreGoneAreReadWhereTheyHadNoEffect) {
  const std::vector<std::array<std::string, 3>> gone = {
      {"loss.class_weights", "[]", "[1, 2]"},
      {"optim.momentum", "0.9", "0.8"},
      {"optim.nesterov", "false", "true"},
      {"optim.period_samples", "0", "5"},
      {"optim.step_factor", "0.1", "0.5"},
      {"optim.min_lr", "0", "1e-5"},
      {"run.weight_seed", "-1", "3"},
      {"run.keep_states", "2", "3"},
      {"run.patience", "0", "5"},
      {"run.best_metric", "miou", "loss_seg"},
      {"run.half_checkpoint", "true", "false"},
      {"run.prefetch", "4", "8"},
      {"data.noise.paper_hole_count", "6", "7"},
      {"data.scene.structure_probability", "1", "0.5"},
      {"data.scene.ceiling_probability", "0.5", "1"},
      {"data.scene.ceiling_height_m", "[2.4, 3.2]", "[2.4, 2.5]"},
      {"data.scene.clutter_size_m", "[0.1, 1.4]", "[0.2, 1.4]"},
      {"data.scene.clutter_clearance_m", "0.05", "0.5"},
      {"data.scene.tripod_distance_m", "[2, 4.5]", "[3, 4.5]"},
      {"data.scene.dark_probability", "0.15", "0.5"}};
  ConfigSource source = ConfigSource::FromFile("configs/m01.yaml");
  for (const auto& [key, harmless, other] : gone) {
    source.Set(key + "=" + harmless);
    const std::string error = SetError(key + "=" + other);
    EXPECT_EQ(error.rfind(key + " (--set) is no longer a key: ", 0), 0u) << error;
  }
  EXPECT_NO_THROW(ReadTrainConfig(source));
  EXPECT_EQ(ReadSavedConfig("loss: {class_weights: []}\n", "old.state").run.samples, 3200000);
  EXPECT_EQ(ReadSavedConfig("data: {noise: {model: paper}}\n", "old.state").data.noise.models,
            std::vector<std::string>{"paper"});
  SetError("optim.optimizer=sgd", "in {adam, adamw}");
  SetError("optim.schedule=cosine", "is none of constant, one_cycle");
}

TEST(TrainConfig, ErrorsNameTheKeyAndTheNearestOne) {
  SetError("loss={terms: [a, a], term_weights: [1, 1]}", "'a' twice");
  SetError("optim.learning_rat=1e-3", "optim.learning_rat");
  SetError("model.base_chanels=4", "model.base_channels");
  SetError("optim.lr=0", "optim.lr");
  SetError("model.normalization=layer", "model.normalization");
  SetError("run.validation_seed=1", "run.validation_seed");
  SetError("run.micro_batch=17", "run.batch_size");
}

Sweep ReadFrom(const std::string& yaml) {
  return ReadSweep(ConfigSource::FromString(yaml, "sweep"));
}

TEST(Sweep, HasEveryCombination) {
  const Sweep sweep = ReadFrom(
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
  EXPECT_EQ(ExpandSweep(ReadFrom("recipes: [configs/m04.yaml]\nseeds: [3]\n"), {}).at(0).name,
            "m04_run.seed=3");
}

TEST(Sweep, SetsARecipeOverAllOthers) {
  const SweepRun run = ExpandSweep(
      ReadFrom("recipes: [configs/m03.yaml]\nover: configs/lite.yaml\nset: {run.samples: 7}\n"),
      {"run.batch_size=3"})[0];
  EXPECT_EQ(run.name, "m03");
  EXPECT_TRUE(run.config.loss.procrustes);
  EXPECT_EQ(run.config.model.base_channels, 8);
  EXPECT_EQ(run.config.data.image_sizes, (std::vector<std::string>{"160x144", "160x90"}));
  EXPECT_EQ(run.config.run.samples, 7);
  EXPECT_EQ(run.config.run.batch_size, 3);
}

TEST(Sweep, SaysWhatIsWrong) {
  ExpectError<ConfigError>([] { ReadFrom("seeds: [1]\n"); }, {"recipes"});
  ExpectError<ConfigError>([] { ReadFrom("recipes: [a.yaml]\nseed: [1]\n"); }, {"seed", "sweep:2"});
  ExpectError<ConfigError>(
      [] { ExpandSweep(ReadFrom("recipes: [configs/m04.yaml]\nset: {optim.lrr: [1]}\n"), {}); },
      {"optim.lrr", "optim.lr"});
  ExpectError<ConfigError>(
      [] { ExpandSweep(ReadFrom("recipes: [configs/m04.yaml]\nseeds: [1, 1]\n"), {}); },
      {"m04_run.seed=1"});
}

TEST(Sweep, GoesOnWhereItStoppedAndPastAFailure) {
  const TempFolder folder;
  const std::vector<std::string> tiny(
      {"model.base_channels=2", "model.residual_blocks=1", "data.image_sizes=[40x36, 64x36]",
       "run.batch_size=2", "run.samples=4", "run.validation_samples=2", "run.threads=1",
       "optim.warmup_samples=2", "loss.min_side_pixels=3", "run.log_every=2",
       "run.checkpoint_every=1000", "run.tensorboard=false"});
  const auto runs =
      ExpandSweep(ReadFrom("recipes: [configs/m05-lite.yaml]\nseeds: [1, 2, 3]\n"), tiny);
  // The second folder holds a run of another configuration.
  auto other = runs[1];
  other.config.loss.lambda = 0.3;
  const std::string dir = folder.path().string();
  EXPECT_TRUE(TrainSweep({other}, dir, true).failures.empty());
  const SweepResult result = TrainSweep(runs, dir, true);
  EXPECT_TRUE(result.finished);
  ASSERT_EQ(result.failures.size(), 1u);
  EXPECT_TRUE(Has(result.failures[0], "loss.lambda"));
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
  const auto runs = ExpandSweep(ReadFrom("recipes: [configs/m05-lite.yaml]\nseeds: [1, 2]\n"),
                                {"run.samples=5000", "run.threads=1"});
  const InterruptGuard guard;
  std::raise(SIGINT);
  const SweepResult result = TrainSweep(runs, (folder / "sweep").string(), true);
  EXPECT_EQ(result.signal, SIGINT);
  EXPECT_FALSE(result.finished);
  EXPECT_FALSE(std::filesystem::exists(folder / "sweep" / runs[0].name));
}

}  // namespace
}  // namespace volalign::train_config_test

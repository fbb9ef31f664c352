#include "train/trainer.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/isfinite.h>
#include <c10/core/GradMode.h>
#include <c10/util/Exception.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/nn/checkpoint.h"
#include "core/nn/cpu/torch_threads.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/train/synthetic_source.h"
#include "tests/train/watched_memory.h"
#include "train/compute.h"
#include "train/state.h"

namespace volalign::trainer_test {
namespace {

using nlohmann::json;

/// Every switch of m05-lite on a tiny network.
TrainConfig TinyConfig() {
  TrainConfig config;
  config.model.base_channels = 2;
  config.model.residual_blocks = 1;
  config.model.normalization = Normalization::kBatch;
  config.model.input = InputEncoding::kDepthMask;
  config.model.background_bias = 2;
  config.loss.keypoints = KeypointKind::kExposed;
  config.loss.min_side_pixels = 5;
  config.loss.lambda_warmup_samples = 40;
  config.optim.optimizer = OptimizerKind::kAdamW;
  config.optim.weight_decay = 0.01;
  config.optim.lr = 3e-3;
  config.optim.schedule = Schedule::kOneCycle;
  config.optim.warmup_samples = 8;
  config.optim.clip_norm = 1;
  config.optim.ema_decay = 0.9;
  config.run.samples = 80;
  config.run.batch_size = 2;
  config.run.log_every = 2;
  config.run.checkpoint_every = 26;
  config.run.validate_every = 60;
  config.run.validation_samples = 2;
  config.run.precision = Precision::kBf16;
  config.run.channels_last = Layout::kChannelsLast;
  SetTorchThreads(1);
  return config;
}

TrainOptions Options(const std::filesystem::path& folder) {
  TrainOptions options;
  options.run_dir = folder;
  options.quiet = true;
  return options;
}

std::filesystem::path State(const std::filesystem::path& folder, int samples) {
  return folder / "states" / fmt::format("{:012}.state", samples);
}

void Truncate(const std::filesystem::path& file) {
  std::filesystem::resize_file(file, std::filesystem::file_size(file) / 2);
}

std::vector<json> Rows(const std::filesystem::path& folder, const std::string& type) {
  std::vector<json> rows;
  std::istringstream text(ReadFile(folder / "metrics.jsonl"));
  for (std::string line; std::getline(text, line);) {
    const json row = json::parse(line);
    if (row.at("type") == type) rows.push_back(row);
  }
  return rows;
}

TEST(Trainer, SaysHowLongTheRunWillTake) {
  const TempFolder folder;
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  const auto said = [&](std::int64_t samples) {
    TrainConfig config = TinyConfig();
    config.run.samples = samples;
    config.run.log_every = 100;
    TrainOptions options = Options(folder / std::to_string(samples));
    options.quiet = false;
    options.stop_at_samples = 120;
    testing::internal::CaptureStderr();
    TrainOn(data, config, options);
    return testing::internal::GetCapturedStderr();
  };
  constexpr std::int64_t kMany = 10'000'000'000;
  const std::string far = said(kMany);
  const std::size_t at = far.find(" days at this speed; configs/paper/lite.yaml suits a CPU\n");
  ASSERT_NE(at, std::string::npos) << far;
  const std::size_t about = far.rfind("about ", at) + 6;
  // The first row is of the same hundred samples.
  const double rate = Rows(folder / std::to_string(kMany), "train")[0].at("samples_per_s");
  const double days = static_cast<double>(kMany - 100) / rate / (24 * 3600);
  EXPECT_NEAR(std::stod(far.substr(about, at - about)), days, 1 + 1e-3 * days);
  EXPECT_EQ(far.find("at this speed", at + 10), std::string::npos) << "said twice";

  const std::string soon = said(1000);
  EXPECT_NE(soon.find(" at this speed\n"), std::string::npos) << soon;
  EXPECT_EQ(soon.find("lite.yaml"), std::string::npos) << soon;
}

TEST(Trainer, ResumedRunRepeatsTheNextTwentyLosses) {
  const TempFolder folder;
  const TrainConfig config = TinyConfig();
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  const TrainResult whole = TrainOn(data, config, Options(folder / "whole"));
  EXPECT_TRUE(whole.finished);
  TrainOptions options = Options(folder / "parts");
  options.stop_at_samples = 40;
  const TrainResult first = TrainOn(data, config, options);
  EXPECT_FALSE(first.finished);
  EXPECT_EQ(first.samples, 40);
  options.stop_at_samples = 0;
  options.resume = true;
  EXPECT_TRUE(TrainOn(data, config, options).finished);

  const std::vector<json> a = Rows(folder / "whole", "train"), b = Rows(folder / "parts", "train");
  ASSERT_EQ(a.size(), 40u);
  ASSERT_EQ(b.size(), 40u);
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (const char* key :
         {"samples", "step", "loss", "loss_seg", "loss_3d", "gradient_norm", "lr"}) {
      EXPECT_EQ(a[i].at(key), b[i].at(key)) << key << " of step " << i + 1;
    }
  }
  // The shipped weights are the same, too, and so is their validation.
  EXPECT_EQ(Rows(folder / "whole", "validation").back().at("loss_seg"),
            Rows(folder / "parts", "validation").back().at("loss_seg"));
  const TensorFile x = ReadTensorFile(folder / "whole" / "model.safetensors", kCheckpointFormat);
  const TensorFile y = ReadTensorFile(folder / "parts" / "model.safetensors", kCheckpointFormat);
  for (const auto& [name, tensor] : x.tensors)
    EXPECT_TRUE(tensor.equal(y.tensors.at(name))) << name;
}

class Resume : public testing::TestWithParam<std::tuple<OptimizerKind, Schedule>> {};

TEST_P(Resume, EndsAsARunThatWasNotStopped) {
  const TempFolder folder;
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  TrainConfig config = TinyConfig();
  const auto [optimizer, schedule] = GetParam();
  config.optim.optimizer = optimizer;
  config.optim.schedule = schedule;
  config.run.samples = 24;
  config.optim.warmup_samples = 4;
  config.run.micro_batch = 1;
  TrainOn(data, config, Options(folder / "whole"));
  TrainOptions options = Options(folder / "parts");
  options.stop_at_samples = 10;
  TrainOn(data, config, options);
  options.stop_at_samples = 0;
  options.resume = true;
  TrainOn(data, config, options);
  EXPECT_TRUE(ReadFile(State(folder / "whole", 24)) == ReadFile(State(folder / "parts", 24)));
}

INSTANTIATE_TEST_SUITE_P(
    Trainer, Resume,
    testing::Combine(testing::Values(OptimizerKind::kAdam, OptimizerKind::kAdamW),
                     testing::Values(Schedule::kConstant, Schedule::kOneCycle)),
    [](const auto& test) {
      return fmt::format("{}_{}", ToString(std::get<0>(test.param)),
                         ToString(std::get<1>(test.param)));
    });

TEST(Trainer, ResumeDropsRowsAfterTheSavedState) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  TrainOptions options = Options(folder / "run");
  options.stop_at_samples = 10;
  TrainOn(data, config, options);
  // What a run that was killed after its last checkpoint leaves behind.
  const std::filesystem::path metrics = folder / "run" / "metrics.jsonl";
  WriteFileAtomically(metrics,
                      ReadFile(metrics) + "{\"type\":\"train\",\"samples\":12}\n{\"type\":\"tr");
  options.resume = true;
  options.stop_at_samples = 14;
  TrainOn(data, config, options);
  const std::vector<json> rows = Rows(folder / "run", "train");
  ASSERT_EQ(rows.size(), 7u);
  for (std::size_t i = 0; i < rows.size(); ++i) EXPECT_EQ(rows[i].at("samples"), 2 * (i + 1));
}

/// Names of the files in a folder, in order.
std::vector<std::string> Names(const std::filesystem::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    names.push_back(entry.path().filename().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

TEST(Trainer, KeepsTheNewestStatesAndPassesOverADamagedOne) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.run.checkpoint_every = 10;
  config.run.validate_every = 20;
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  TrainOn(data, config, Options(folder / "whole"));
  TrainOptions options = Options(folder / "run");
  options.stop_at_samples = 46;
  TrainOn(data, config, options);
  EXPECT_EQ(Names(folder / "run" / "states"),
            (std::vector<std::string>{"000000000040.state", "000000000046.state"}));
  Truncate(State(folder / "run", 46));
  options.stop_at_samples = 44;
  options.resume = true;
  EXPECT_EQ(TrainOn(data, config, options).samples, 44);  // from 40, not from 46
  EXPECT_EQ(Names(folder / "run" / "states"),
            (std::vector<std::string>{"000000000040.state", "000000000044.state"}));
  options.stop_at_samples = 0;
  EXPECT_TRUE(TrainOn(data, config, options).finished);
  EXPECT_EQ(Names(folder / "run" / "states"),
            (std::vector<std::string>{"000000000070.state", "000000000080.state"}));
  EXPECT_EQ(Names(folder / "run"),
            (std::vector<std::string>{"best.safetensors", "config.yaml", "intrinsics.yaml",
                                      "metrics.jsonl", "model.safetensors", "states",
                                      "structure.yaml", "tensorboard"}));
  for (const char* name : {"best.safetensors", "model.safetensors"}) {
    const auto a = ReadTensorFile(folder / "whole" / name, kCheckpointFormat).tensors;
    const auto b = ReadTensorFile(folder / "run" / name, kCheckpointFormat).tensors;
    for (const auto& [tensor, value] : a) EXPECT_TRUE(value.equal(b.at(tensor))) << tensor;
  }
}

TEST(Trainer, BestCheckpointIsThatOfTheBestValidation) {
  // At no speed all validations are alike, and the first of them stays the best.
  for (const double lr : {0.05, 1e-30}) {
    const TempFolder folder;
    TrainConfig config = TinyConfig();
    config.run.validate_every = 10;
    config.model.normalization = Normalization::kNone;
    config.optim.schedule = Schedule::kConstant;
    config.optim.lr = lr;
    config.optim.weight_decay = 0;
    TrainOn(SyntheticData(2, 32, 1u << 20), config, Options(folder / "run"));
    double best = -1;
    std::int64_t at = 0;
    const std::vector<json> rows = Rows(folder / "run", "validation");
    for (const json& row : rows)
      EXPECT_EQ(row.contains("median_translation_error_m"), row.at("posed") > 0);
    ASSERT_EQ(rows.size(), 8u);
    for (const json& row : rows) {
      if (row.at("miou").get<double>() <= best) continue;
      best = row.at("miou").get<double>();
      at = row.at("samples").get<std::int64_t>();
    }
    if (lr < 0.01) {
      EXPECT_EQ(at, 10);
    }
    EXPECT_EQ(LoadCheckpoint(folder / "run" / "best.safetensors").meta.samples, at);
    EXPECT_EQ(LoadCheckpoint(folder / "run" / "model.safetensors").meta.samples, 80);
  }
}

// Frames that are held out are there without rendered samples.
TEST(Trainer, ValidatesOnHeldOutFramesWhereNoSampleIsRenderedForIt) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.run.samples = 4;
  config.run.validation_samples = 0;
  TrainingData data = SyntheticData(2, 32, 1u << 20);
  data.validation_frames = 2;
  const TrainResult result = TrainOn(data, config, Options(folder / "run"));
  EXPECT_EQ(result.validation.samples, 2);
  EXPECT_EQ(Rows(folder / "run", "validation").size(), 1u);
  EXPECT_TRUE(std::filesystem::exists(folder / "run" / "best.safetensors"));
}

// So is a short trial of a recipe: its beginning.
TEST(Trainer, SaysThatAWarmUpIsLongerThanTheRun) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.run.samples = config.optim.warmup_samples = 4;
  TrainOptions options = Options(folder / "run");
  options.quiet = false;
  testing::internal::CaptureStderr();
  EXPECT_TRUE(TrainOn(SyntheticData(2, 32, 1u << 20), config, options).finished);
  const std::string said = testing::internal::GetCapturedStderr();
  EXPECT_NE(said.find("optim.warmup_samples = 4 is not shorter than run.samples = 4"),
            std::string::npos)
      << said;
  const double lr = Rows(folder / "run", "train").back().at("lr");
  EXPECT_LT(lr, config.optim.lr);
}

TEST(Trainer, AResumedRunKeepsThePrecisionThatAutoChose) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.run.precision = Precision::kAuto;
  config.run.channels_last = Layout::kAuto;
  config.run.samples = 8;
  config.optim.warmup_samples = 2;
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  TrainOptions options = Options(folder / "run");
  options.stop_at_samples = 4;
  TrainOn(data, config, options);
  // As if it had begun on a machine where auto chooses otherwise.
  const std::filesystem::path path = State(folder / "run", 4);
  TensorFile state = ReadTensorFile(path, kStateFormat);
  json meta = json::parse(state.meta);
  EXPECT_EQ(meta.at("bf16").get<bool>(), ProcessorHasBf16());
  meta["bf16"] = !ProcessorHasBf16();
  meta["channels_last"] = !meta.at("channels_last").get<bool>();
  state.meta = meta.dump();
  WriteTensorFile(path, state);
  options.resume = true;
  options.stop_at_samples = 0;
  EXPECT_TRUE(TrainOn(data, config, options).finished);
  const json after = json::parse(ReadTensorFile(State(folder / "run", 8), kStateFormat).meta);
  EXPECT_EQ(after.at("bf16"), meta.at("bf16"));
  EXPECT_EQ(after.at("channels_last"), meta.at("channels_last"));
}

TEST(Trainer, TwoProcessesDoNotTrainInOneFolder) {
  const TempFolder folder;
  const RunFolder held(folder / "run");
  ExpectError<IoError>(
      [&] { TrainOn(SyntheticData(2, 32, 8), TinyConfig(), Options(folder / "run")); },
      {"another volalign", "run"});
}

/// As that of a process that was killed and still gives its memory back.
TEST(RunFolder, WaitsForAnotherThatEnds) {
  const TempFolder folder;
  auto held = std::make_unique<RunFolder>(folder / "run");
  std::thread end([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    held.reset();
  });
  EXPECT_NO_THROW(RunFolder(folder / "run"));
  end.join();
}

TEST(Trainer, TinyNetworkOverfitsAFixedBatch) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.model.base_channels = 4;
  config.run.seed = 3;
  config.run.batch_size = 4;
  config.run.samples = std::int64_t{4} * 200;
  config.run.log_every = 4;
  config.run.checkpoint_every = config.run.validate_every = 1000000;
  config.run.validation_samples = 0;
  config.run.precision = Precision::kFp32;
  config.optim.lr = 1e-2;
  config.optim.schedule = Schedule::kConstant;
  config.optim.warmup_samples = 40;
  TrainOn(SyntheticData(4, 32, 4), config, Options(folder / "run"));
  const std::vector<json> rows = Rows(folder / "run", "train");
  const double first = rows.front().at("loss_seg").get<double>();
  const double last = rows.back().at("loss_seg").get<double>();
  // With seeds 1 to 72 it ends at 0.04 to 0.33 times the first loss, rounding alone moving a seed's
  // result by as much as 0.15; this seed is one of the lowest.
  EXPECT_TRUE(last < 0.4 * first) << first << " -> " << last;
  EXPECT_TRUE(rows.back().at("loss_3d").get<double>() <
              0.5 * rows.front().at("loss_3d").get<double>());
}

TEST(Trainer, WritesADeployableCheckpointAndTheResolvedConfig) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.run.samples = 12;
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  const TrainResult result = TrainOn(data, config, Options(folder / "run"));
  const LoadedModel model = LoadCheckpoint(result.checkpoint);
  EXPECT_EQ(model.meta.samples, 12);
  EXPECT_EQ(model.meta.structure.Hash(), data.structure.Hash());
  EXPECT_NEAR(model.meta.focal_px.first, 0.8 * 32, 1e-9);
  EXPECT_NEAR(model.meta.focal_px.second, 0.8 * 32, 1e-9);
  EXPECT_EQ(model.meta.image_sizes, (std::vector<std::pair<int, int>>{{32, 32}}));
  EXPECT_EQ(model.meta.roll_offsets_deg, std::vector<double>{90});
  EXPECT_EQ(model.meta.config_yaml, WriteConfig(config));
  EXPECT_EQ(ReadFile(folder / "run" / "config.yaml"), WriteConfig(config));
  const std::vector<json> validation = Rows(folder / "run", "validation");
  ASSERT_EQ(validation.size(), 1u);
  for (const char* key : {"loss_seg", "miou", "miou_authors"}) {
    EXPECT_TRUE(std::isfinite(validation[0].at(key).get<double>())) << key;
  }
  const json row = Rows(folder / "run", "train").back();
  for (const char* stage : {"data", "forward", "loss", "backward", "optim"}) {
    EXPECT_GT(row.at("step_s").at(stage).get<double>(), 0) << stage;
  }
}

TEST(Trainer, AverageIsTheRunningMeanOfTheWeights) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.optim.warmup_samples = 2;
  config.run.samples = 6;  // three steps: decays 2/11, 3/12, 4/13 as (1 + t) / (10 + t)
  config.run.log_every = 2;
  config.run.checkpoint_every = 2;
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  std::vector<at::Tensor> weights;
  at::Tensor average;
  for (int stop : {2, 4, 6}) {
    TrainOptions options = Options(folder / "run");
    options.stop_at_samples = stop;
    options.resume = stop > 2;
    TrainOn(data, config, options);
    const TensorFile state = ReadTensorFile(State(folder / "run", stop), kStateFormat);
    const auto batches = stop / 2;
    const auto t = static_cast<double>(batches);
    const double decay = (1 + t) / (10 + t);
    const at::Tensor w = state.tensors.at("model/merge2.weight").to(at::kDouble);
    const at::Tensor saved = state.tensors.at("average/merge2.weight").to(at::kDouble);
    if (stop > 2) {
      const at::Tensor expected = decay * average + (1 - decay) * w;
      EXPECT_LT((saved - expected).abs().max().item<double>(), 1e-7);
      EXPECT_GT((saved - w).abs().max().item<double>(), 1e-5);
    }
    average = saved;
  }
}

TEST(Trainer, ExplainsWhatCannotBeResumed) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  TrainOptions options = Options(folder / "run");
  options.stop_at_samples = 4;
  options.resume = true;
  ExpectError<IoError>([&] { TrainOn(data, config, options); },
                       {"run", "no run to resume", "--resume"});
  EXPECT_FALSE(std::filesystem::exists(folder / "run"));
  options.resume = false;
  TrainOn(data, config, options);
  ExpectError<Error>([&] { TrainOn(data, config, options); }, {"run", "--resume"});

  options.resume = true;
  TrainConfig other = config;
  other.data.pose.rho_cm = {150, 350};
  ExpectError<ConfigError>([&] { TrainOn(data, other, options); },
                           {"data.pose.rho_cm", "350", "275"});
  other = config;
  other.run.seed = 7;
  ExpectError<ConfigError>([&] { TrainOn(data, other, options); }, {"run.seed", "7"});
  other = config;
  other.run.samples = 120;  // one_cycle: another learning rate
  ExpectError<ConfigError>([&] { TrainOn(data, other, options); },
                           {"run.samples = 120", "80", "optim.schedule", "run.init"});
  other = config;
  other.run.log_every = 4;  // changes no step
  options.stop_at_samples = 8;
  EXPECT_EQ(TrainOn(data, other, options).samples, 8);

  for (const int samples : {4, 8}) Truncate(State(folder / "run", samples));
  ExpectError<DataError>([&] { TrainOn(data, config, options); }, {"000000000004.state"});
}

TEST(Trainer, AConstantScheduleMayBeContinuedForLonger) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.optim.schedule = Schedule::kConstant;
  config.run.samples = 4;
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  TrainOptions options = Options(folder / "run");
  EXPECT_TRUE(TrainOn(data, config, options).finished);
  config.run.samples = 8;
  options.resume = true;
  EXPECT_EQ(TrainOn(data, config, options).samples, 8);
}

TEST(Trainer, StopsCleanlyOnASignal) {
  /// Raises the signal while the third batch is drawn.
  class Interrupting : public SampleSource {
   public:
    explicit Interrupting(std::unique_ptr<SampleSource> inner) : inner_(std::move(inner)) {}
    std::vector<Sample> Next() override {
      if (++calls_ == 3) std::raise(SIGTERM);
      return inner_->Next();
    }

   private:
    std::unique_ptr<SampleSource> inner_;
    int calls_ = 0;
  };
  const TempFolder folder;
  TrainingData data = SyntheticData(2, 32, 1u << 20);
  const auto open = data.open_training;
  data.open_training = [&](std::int64_t first_sample) {
    return std::make_unique<Interrupting>(open(first_sample));
  };
  const TrainResult result = TrainOn(data, TinyConfig(), Options(folder / "run"));
  EXPECT_FALSE(result.finished);
  EXPECT_EQ(result.samples, 6);
  EXPECT_EQ(LoadCheckpoint(folder / "run" / "model.safetensors").meta.samples, 6);
}

/// Raises a signal while a batch of the number `at`, from 1, is drawn.
class Signalling : public SampleSource {
 public:
  Signalling(std::unique_ptr<SampleSource> inner, int at) : inner_(std::move(inner)), at_(at) {}
  std::vector<Sample> Next() override {
    if (++calls_ == at_) std::raise(SIGINT);
    return inner_->Next();
  }

 private:
  std::unique_ptr<SampleSource> inner_;
  int at_, calls_ = 0;
};

// A validation that is stopped is made up for by the run that goes on.
TEST(Trainer, StopsWithinAValidation) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.optim.warmup_samples = 4;
  config.run.validate_every = 4;
  config.run.validation_samples = 6;
  config.run.samples = 8;
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  EXPECT_EQ(TrainOn(data, config, Options(folder / "whole")).signal, 0);

  TrainingData stopping = data;
  int drawn = 0, opened = 0;
  stopping.open_validation = [&]() -> std::unique_ptr<SampleSource> {
    class Counted : public SampleSource {
     public:
      Counted(std::unique_ptr<SampleSource> inner, int* drawn)
          : inner_(std::move(inner)), drawn_(drawn) {}
      std::vector<Sample> Next() override {
        ++*drawn_;
        return inner_->Next();
      }

     private:
      std::unique_ptr<SampleSource> inner_;
      int* drawn_;
    };
    ++opened;
    return std::make_unique<Signalling>(std::make_unique<Counted>(data.open_validation(), &drawn),
                                        1);
  };
  TrainOptions options = Options(folder / "run");
  TrainResult result = TrainOn(stopping, config, options);
  EXPECT_EQ(result.signal, SIGINT);
  EXPECT_FALSE(result.finished);
  EXPECT_EQ(result.samples, 4);
  EXPECT_EQ(drawn, 1);  // of three batches
  options.resume = true;
  result = TrainOn(data, config, options);
  EXPECT_TRUE(result.finished);
  for (const char* file : {"states/000000000008.state", "best.safetensors"})
    EXPECT_TRUE(ReadFile(folder / "run" / file) == ReadFile(folder / "whole" / file)) << file;
  EXPECT_EQ(Rows(folder / "run", "validation"), Rows(folder / "whole", "validation"));
  // In the last validation, too: the run is not finished then.
  stopping.open_training = data.open_training;
  options = Options(folder / "last");
  config.run.validate_every = 8;
  result = TrainOn(stopping, config, options);
  EXPECT_EQ(result.samples, 8);
  EXPECT_FALSE(result.finished);
  options.resume = true;
  EXPECT_TRUE(TrainOn(data, config, options).finished);
  EXPECT_EQ(opened, 2);
}

// The step that is stopped is done again by the run that goes on.
TEST(Trainer, StopsBetweenMicroBatches) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.model.normalization = Normalization::kBatch;  // which moves with each micro-batch
  config.optim.warmup_samples = 4;
  config.run.micro_batch = 1;
  config.run.samples = 8;
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  TrainOn(data, config, Options(folder / "whole"));
  TrainingData stopping = data;
  stopping.open_training = [&](std::int64_t first) {
    return std::make_unique<Signalling>(data.open_training(first), 3);
  };
  TrainOptions options = Options(folder / "run");
  const TrainResult result = TrainOn(stopping, config, options);
  EXPECT_EQ(result.signal, SIGINT);
  EXPECT_EQ(result.samples, 4);  // of the two steps before
  options.resume = true;
  EXPECT_TRUE(TrainOn(data, config, options).finished);
  const char* state = "states/000000000008.state";
  EXPECT_TRUE(ReadFile(folder / "run" / state) == ReadFile(folder / "whole" / state));
}

/// Synthetic training samples of which `change` gets each batch and its number, from 1.
TrainingData Changed(std::function<void(std::vector<Sample>* batch, int number)> change) {
  class Source : public SampleSource {
   public:
    Source(std::unique_ptr<SampleSource> inner,
           std::function<void(std::vector<Sample>*, int)> change)
        : inner_(std::move(inner)), change_(std::move(change)) {}
    std::vector<Sample> Next() override {
      std::vector<Sample> batch = inner_->Next();
      change_(&batch, ++calls_);
      return batch;
    }

   private:
    std::unique_ptr<SampleSource> inner_;
    std::function<void(std::vector<Sample>*, int)> change_;
    int calls_ = 0;
  };
  TrainingData data = SyntheticData(2, 32, 1u << 20);
  data.open_training = [change = std::move(change),
                        open = data.open_training](std::int64_t first_sample) {
    return std::make_unique<Source>(open(first_sample), change);
  };
  return data;
}

/// Samples of which the batches [first, last], from 1, have a depth that is not finite.
TrainingData Poisoned(int first, int last) {
  return Changed([first, last](std::vector<Sample>* batch, int number) {
    if (number >= first && number <= last)
      batch->front().depth(16, 16) = std::numeric_limits<float>::infinity();
  });
}

TEST(Trainer, SkipsAStepThatIsNotFinite) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();  // with a batch normalisation, whose statistics are kept too
  config.model.input = InputEncoding::kDepth;
  config.run.log_every = 8;
  const TrainResult result = TrainOn(Poisoned(15, 16), config, Options(folder / "run"));
  EXPECT_TRUE(result.finished);
  std::int64_t skipped = 0;
  for (const json& row : Rows(folder / "run", "train")) {
    skipped += row.at("skipped").get<std::int64_t>();
    EXPECT_TRUE(row.at("loss").is_number()) << row;
  }
  EXPECT_EQ(skipped, 2);
  EXPECT_EQ(Rows(folder / "run", "train").back().at("step"), 38);
  const LoadedModel model = LoadCheckpoint(folder / "run" / "model.safetensors");
  for (const at::Tensor& t : model.net->parameters())
    EXPECT_TRUE(at::isfinite(t).all().item<bool>());
  for (const at::Tensor& t : model.net->buffers()) EXPECT_TRUE(at::isfinite(t).all().item<bool>());
}

TEST(Trainer, StopsWhereNoStepIsFinite) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.model.input = InputEncoding::kDepth;
  ExpectError<Error>([&] { TrainOn(Poisoned(15, 15), config, Options(folder / "run")); },
                     {"step 15", "states/000000000026.state", "optim.lr"});
  EXPECT_EQ(LoadCheckpoint(folder / "run" / "model.safetensors").meta.samples, 26);
}

/// As a device whose memory is short: once it is armed, the next request of this thread for more
/// than a kilobyte fails as CUDA's do.
TEST(Trainer, SaysWhatToDoWhereMemoryIsShort) {
  const TempFolder folder;
  std::atomic<bool> armed{false};
  const std::thread::id trains = std::this_thread::get_id();
  const WatchedMemory memory([&](std::size_t bytes) {
    TORCH_CHECK_WITH(
        OutOfMemoryError,
        bytes <= 1000 || std::this_thread::get_id() != trains || !armed.exchange(false),
        "CUDA out of memory. Tried to allocate ", bytes, " bytes");
  });
  const TrainConfig config = TinyConfig();
  // Two batches may be drawn ahead of the one that is trained with.
  const TrainingData data = Changed([&](auto*, int number) {
    if (number == 20) armed = true;
  });
  ExpectError<Error>([&] { TrainOn(data, config, Options(folder / "run")); },
                     {"cpu is out of memory with 2 samples at once", "run.micro_batch",
                      "states/000000000026.state"});
  TrainOptions again = Options(folder / "run");
  again.resume = true;
  EXPECT_TRUE(TrainOn(SyntheticData(2, 32, 1u << 20), config, again).finished);
}

TEST(Trainer, RejectsAnUnknownDevice) {
  const TempFolder folder;
  TrainConfig config = TinyConfig();
  config.run.device = "tpu";
  ExpectError<ConfigError>(
      [&] { TrainOn(SyntheticData(2, 32, 8), config, Options(folder / "run")); },
      {"run.device", "tpu"});
}

}  // namespace
}  // namespace volalign::trainer_test

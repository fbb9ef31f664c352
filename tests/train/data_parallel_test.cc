// Several processes train as one does.

#include <ATen/TensorOperators.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "core/base/file_util.h"
#include "core/nn/checkpoint.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/train/distributed/in_processes.h"
#include "tests/train/synthetic_source.h"
#include "train/data_parallel.h"
#include "train/trainer.h"

namespace volalign::data_parallel_test {
namespace {

namespace fs = std::filesystem;

/// Rows, states and the image size's changes come at different numbers of samples.
TrainConfig SmallConfig(Normalization normalization) {
  // Uncentred depth makes group normalisation ill-conditioned; Adam makes whole steps of rounding
  // errors.
  TrainConfig config = ConfigOf(R"(
model: {base_channels: 2, residual_blocks: 1, input: depth_mask}
loss: {min_side_pixels: 3}
optim: {lr: 1e-6, clip_norm: 5, ema_decay: 0.9}
run: {samples: 35, batch_size: 5, log_every: 10, checkpoint_every: 15, validate_every: 20,
      validation_samples: 10, tensorboard: false, lost_after_s: 60})");
  config.model.normalization = normalization;
  return config;
}

void TrainHere(const World& world, const TrainConfig& config, const fs::path& run_dir,
               std::int64_t stop = 0, bool resume = false,
               const std::function<void(std::int64_t)>& at_sample = {}) {
  TrainOptions options = QuietRun(run_dir, stop, resume);
  options.world = world;
  const BatchSlice slice = world.size > 1 ? SliceOf(5, world.rank, world.size) : BatchSlice();
  TrainingData data = SyntheticData(5, 32, 1u << 20, slice);
  if (at_sample) {
    data.open_training = WatchedSource(
        data.open_training,
        [at_sample](std::vector<Sample>*, int number) { at_sample(5 * (number - 1)); });
  }
  TrainOn(data, config, options);
}

/// With `losses_alone`, other numbers may differ.
void ExpectSameRows(const fs::path& a, const fs::path& b, bool losses_alone = false) {
  const std::vector<nlohmann::json> expected = MetricsRows(a), found = MetricsRows(b);
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_EQ(found[i].size(), expected[i].size()) << found[i] << expected[i];
    for (const auto& [key, value] : expected[i].items()) {
      if (losses_alone && key.rfind("loss", 0) != 0) continue;
      if (!value.is_number()) {
        EXPECT_EQ(found[i].at(key), value);
        continue;
      }
      const auto number = value.get<double>();
      EXPECT_NEAR(found[i].at(key).get<double>(), number, 1e-9 + 2e-4 * std::abs(number))
          << key << " of row " << i;
    }
  }
}

/// Largest difference of the weights of two runs, over that between the second and a new network.
double Difference(const fs::path& a, const fs::path& b) {
  const TensorFile first = ReadTensorFile(a, kStateFormat),
                   second = ReadTensorFile(b, kStateFormat);
  double difference = 0, size = 0;
  for (const auto& [name, tensor] : second.tensors) {
    difference = std::max(difference, (first.tensors.at(name) - tensor).abs().max().item<double>());
    if (name.rfind("optimizer/", 0) == 0) size = std::max(size, tensor.abs().max().item<double>());
  }
  return difference / size;
}

constexpr char kLast[] = "states/000000000035.state";

class DataParallel : public testing::TestWithParam<Normalization> {};

// Also with a slice of 1 beside slices of 2 samples, and resumed with another number of processes.
TEST_P(DataParallel, SeveralProcessesTrainAsOneDoes) {
  const TrainConfig config = SmallConfig(GetParam());
  const TempFolder folder;
  ASSERT_EQ(InProcesses(1, folder.path(),
                        [&](const World& world) { TrainHere(world, config, folder / "one"); }),
            std::vector<int>(1, 0));
  for (const int size : {2, 3}) {
    SCOPED_TRACE(size);
    const fs::path run = folder / fmt::format("of{}", size);
    ASSERT_EQ(InProcesses(size, folder.path(),
                          [&](const World& world) { TrainHere(world, config, run, 20); }),
              std::vector<int>(static_cast<std::size_t>(size), 0));
    // The rest with another number: 3 -> 2 and 2 -> 1.
    ASSERT_EQ(InProcesses(size - 1, folder.path(),
                          [&](const World& world) { TrainHere(world, config, run, 0, true); }),
              std::vector<int>(static_cast<std::size_t>(size - 1), 0));
    // Group normalisation of a constant patch leaves nothing but rounding errors, whose signs a
    // ReLU then tells apart: gradients jump, also between batches in parts in one process.
    const bool jumps = config.model.normalization == Normalization::kGroup;
    ExpectSameRows(folder / "one", run, jumps);
    if (!jumps) {
      EXPECT_LT(Difference(run / kLast, folder / "one" / kLast), 2e-4);
    }
    // Cameras that other processes have seen are in the checkpoint.
    EXPECT_EQ(LoadCheckpoint(run / "model.safetensors").meta.focal_px,
              LoadCheckpoint(folder / "one" / "model.safetensors").meta.focal_px);
  }
}
INSTANTIATE_TEST_SUITE_P(Normalization, DataParallel,
                         testing::Values(Normalization::kNone, Normalization::kGroup));

TEST(DataParallelProcesses, ALostOneEndsTheRunWithAStateToGoOnFrom) {
  const TrainConfig config = SmallConfig(Normalization::kNone);
  const TempFolder folder;
  InProcesses(1, folder.path(),
              [&](const World& world) { TrainHere(world, config, folder / "one"); });
  const std::vector<int> statuses = InProcesses(3, folder.path(), [&](const World& world) {
    TrainHere(world, config, folder / "run", 0, false, [&](std::int64_t position) {
      if (world.rank == 1 && position == 25) ::raise(SIGKILL);
    });
  });
  EXPECT_EQ(statuses, (std::vector<int>{1, 128 + SIGKILL, 1}));
  for (const int rank : {0, 2}) {
    const std::string message = ReadFile(folder / fmt::format("message{}", rank));
    EXPECT_TRUE(Has(message, "after 25 samples: lost another process (", "--resume"));
  }
  EXPECT_TRUE(fs::exists(folder / "run" / "states" / "000000000025.state"));
  ASSERT_EQ(
      InProcesses(2, folder.path(),
                  [&](const World& world) { TrainHere(world, config, folder / "run", 0, true); }),
      std::vector<int>(2, 0));
  ExpectSameRows(folder / "one", folder / "run");
  EXPECT_LT(Difference(folder / "run" / kLast, folder / "one" / kLast), 2e-4);
}

// One that is there and does not answer: its machine hangs, or the network is cut.
TEST(DataParallelProcesses, ASilentOneIsLostAfterTheTimeLimit) {
  TrainConfig config = SmallConfig(Normalization::kNone);
  config.run.lost_after_s = 2;
  const TempFolder folder;
  const std::vector<int> statuses = InProcesses(2, folder.path(), [&](const World& world) {
    TrainHere(world, config, folder / "run", 0, false, [&](std::int64_t position) {
      if (world.rank == 1 && position == 10) {
        std::this_thread::sleep_for(std::chrono::seconds(8));
        ::_exit(7);
      }
    });
  });
  EXPECT_EQ(statuses, (std::vector<int>{1, 7}));
  const std::string message = ReadFile(folder / "message0");
  EXPECT_TRUE(Has(message, "after 10 samples: lost another process ("));
}

// Adam, the default, keeps more between steps than what rounding makes of a sum.
TEST(DataParallelProcesses, ResumeAdamExactly) {
  TrainConfig config = SmallConfig(Normalization::kNone);
  const TempFolder folder;
  const auto train = [&](const char* run, std::int64_t stop_at, bool resume) {
    EXPECT_EQ(InProcesses(2, folder.path(),
                          [&](const World& world) {
                            TrainHere(world, config, folder / run, stop_at, resume);
                          }),
              std::vector<int>(2, 0));
  };
  train("whole", 0, false);
  train("parts", 20, false);
  train("parts", 0, true);
  EXPECT_TRUE(ReadFile(folder / "whole" / kLast) == ReadFile(folder / "parts" / kLast));
}

TEST(DataParallelProcesses, AgreeOnConfigurationOrSayWhatDiffers) {
  const TempFolder folder;
  EXPECT_EQ(InProcesses(2, folder.path(),
                        [&](const World& world) {
                          TrainConfig config = SmallConfig(Normalization::kNone);
                          if (world.rank == 1) config.loss.lambda = 0.3;
                          if (world.rank == 1) config.run.threads = 1;  // may differ
                          TrainHere(world, config, folder / "run");
                        }),
            (std::vector<int>{1, 1}));
  const std::string message = ReadFile(folder / "message1");
  EXPECT_TRUE(Has(message, "rank 1 has loss.lambda = 0.3, and rank 0 0.1"));
  // What is wrong with rank 0's folder, every process says.
  EXPECT_EQ(InProcesses(2, folder.path(),
                        [&](const World& world) {
                          TrainHere(world, SmallConfig(Normalization::kNone), folder / "none", 0,
                                    true);
                        }),
            (std::vector<int>{1, 1}));
  EXPECT_TRUE(Has(ReadFile(folder / "message0"), "there is no run to resume"));
  EXPECT_TRUE(Has(ReadFile(folder / "message1"), "rank 0: "));
}

TEST(RequireProcesses, RefusesWhatWouldTrainAnotherNetwork) {
  if (!ProcessGroup::IsBuilt()) {
    ExpectError<ConfigError>([] { RequireProcesses(SmallConfig(Normalization::kNone), 2); },
                             {"libgloo-dev"});
    return;
  }
  RequireProcesses(SmallConfig(Normalization::kNone), 5);
  ExpectError<ConfigError>([] { RequireProcesses(SmallConfig(Normalization::kNone), 6); },
                           {"run.batch_size = 5", "6 processes"});
  ExpectError<ConfigError>([] { RequireProcesses(SmallConfig(Normalization::kBatch), 2); },
                           {"model.normalization"});
}

}  // namespace
}  // namespace volalign::data_parallel_test

// A run that is killed again and again, and resumed, ends as one that was left alone.

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <random>
#include <string>
#include <system_error>
#include <thread>

#include "core/base/file_util.h"
#include "core/nn/cpu/torch_threads.h"
#include "tests/core/base/long_tests.h"
#include "tests/core/base/temp_folder.h"
#include "tests/train/synthetic_source.h"
#include "train/trainer.h"

namespace volalign::kill_test {
namespace {

namespace fs = std::filesystem;
using std::chrono::microseconds;

/// Rows, states and checkpoints come at numbers of samples that do not divide each other.
TrainConfig KillConfig() {
  return ConfigOf(R"(
model: {base_channels: 2, residual_blocks: 1, normalization: batch}
optim: {lr: 3e-3, schedule: one_cycle, warmup_samples: 8, ema_decay: 0.9}
run: {samples: 60, batch_size: 2, log_every: 6, checkpoint_every: 4, validate_every: 10,
      validation_samples: 2})");
}

/// Trains in a process of its own, which the caller may kill; LibTorch stays unused in this one, so
/// that its threads are no matter.
pid_t Start(const fs::path& run_dir) {
  const pid_t child = ::fork();
  if (child != 0) return child;
  int status = 1;
  try {
    SetTorchThreads(1);
    const TrainOptions options = QuietRun(run_dir, 0, fs::exists(run_dir / "config.yaml"));
    if (TrainOn(SyntheticData(2, 32, 1u << 20), KillConfig(), options).finished) status = 0;
  } catch (const std::exception& e) {
    fmt::print(stderr, "{}\n", e.what());
  }
  ::_exit(status);
}

/// True where there is a file that is being written.
bool IsWriting(const fs::path& folder) {
  std::error_code gone;
  for (fs::directory_iterator entry(folder, gone), end; !gone && entry != end;
       entry.increment(gone)) {
    if (entry->path().filename().string().find(".tmp-") != std::string::npos) return true;
  }
  return false;
}

/// Kills once, at a moment within `span` from the start, or, with `while_writing`, at one when a
/// state or checkpoint is being written. False: the run ended before that.
bool KillOnce(pid_t child, const fs::path& run_dir, microseconds moment, bool while_writing) {
  const auto until = std::chrono::steady_clock::now() + moment;
  bool written = !while_writing;
  int status = 0;
  while (!written || std::chrono::steady_clock::now() < until) {
    if (::waitpid(child, &status, WNOHANG) == child) {
      EXPECT_EQ(status, 0);
      return false;
    }
    if (std::chrono::steady_clock::now() >= until) {
      written = IsWriting(run_dir / "states") || IsWriting(run_dir);
    }
    std::this_thread::sleep_for(microseconds(20));
  }
  ::kill(child, SIGKILL);
  ::waitpid(child, &status, 0);
  return WIFSIGNALED(status);
}

// trainer_test resumes runs of every optimizer.
TEST(Kill, ARunKilledAtAnyMomentEndsAsOneThatWasNot) {
  const int kills = static_cast<int>(Rounds(30, 200));
  const TempFolder folder;
  int status = 1;
  const auto start = std::chrono::steady_clock::now();
  ::waitpid(Start(folder / "whole"), &status, 0);
  ASSERT_EQ(status, 0);
  const auto span =
      std::chrono::duration_cast<microseconds>(std::chrono::steady_clock::now() - start);

  std::mt19937 random(1);
  int done = 0, in_files = 0, runs = 0;
  while (done < kills || runs == 0) {
    const fs::path run_dir = folder / fmt::format("run{}", runs);
    bool finished = false;
    while (!finished) {
      // Moments within the first third, so that several kills fall on one run.
      const microseconds moment(random() % static_cast<unsigned>(span.count() / 3 + 1));
      const bool while_writing = done < kills && random() % 2 == 0;
      const pid_t child = Start(run_dir);
      if (done >= kills) {
        ::waitpid(child, &status, 0);
        ASSERT_EQ(status, 0);
        finished = true;
      } else if (KillOnce(child, run_dir, moment, while_writing)) {
        ++done;
        in_files += IsWriting(run_dir / "states") || IsWriting(run_dir);
      } else {
        finished = true;
      }
    }
    ++runs;
    for (const char* file :
         {"states/000000000060.state", "model.safetensors", "best.safetensors"}) {
      EXPECT_TRUE(ReadFile(run_dir / file) == ReadFile(folder / "whole" / file))
          << file << " of run " << runs << " after " << done << " kills";
    }
    EXPECT_EQ(MetricsRows(run_dir), MetricsRows(folder / "whole"));
    EXPECT_FALSE(IsWriting(run_dir) || IsWriting(run_dir / "states"));
  }
  EXPECT_GT(in_files, 0) << "no kill fell into the writing of a file";
  fmt::print("{} kills of {} runs, {} of them while a file was being written\n", done, runs,
             in_files);
}

}  // namespace
}  // namespace volalign::kill_test

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "cli/options.h"
#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/folder.h"
#include "core/base/input_file.h"
#include "core/base/interrupt.h"
#include "core/nn/cpu/torch_threads.h"
#include "train/compute.h"
#include "train/data_parallel.h"
#include "train/distributed/launch.h"
#include "train/log/run_log.h"
#include "train/run_inputs.h"
#include "train/sweep.h"
#include "train/train_config.h"
#include "train/trainer.h"

namespace volalign {

namespace {

struct TrainCommandOptions {
  std::string config, sweep, run_dir;
  std::vector<std::string> assignments;
  bool resume = false;
  int processes = 1;
};

/// Sets run.threads if the recipe leaves it open: as the run began, or as many as are idle here for
/// each of `processes` on this machine.
void ChooseThreads(const std::filesystem::path& run_dir, int idle, int processes,
                   TrainConfig* config) {
  int& threads = config->run.threads;
  const std::filesystem::path saved = run_dir / "config.yaml";
  if (threads == 0 && std::filesystem::exists(saved))
    threads = ReadSavedConfig(ReadFile(saved, kMaxTextBytes), saved.string()).run.threads;
  if (threads == 0) threads = std::max(1, idle / processes);
  if (threads > 1 && threads * processes > idle)
    fmt::print(stderr,
               "warning: run.threads = {}, but only {} of {} processors are idle. Beside other "
               "programs, run.threads=1 may be several times as fast\n",
               threads, idle, std::thread::hardware_concurrency());
}

int TrainOne(const TrainCommandOptions& options) {
  WaitPassively();
  TrainOptions train_options;
  train_options.world = ReadWorld();
  train_options.run_dir = options.run_dir;
  train_options.resume = options.resume;
  train_options.begun = [&] { SaveStart(options.run_dir); };
  TrainConfig config = ReadTrainConfig(ReadSource(options.config, options.assignments));
  std::vector<std::filesystem::path> keepers = {
      std::filesystem::path(FindInputFile(options.config)).parent_path()};
  if (options.resume) keepers.insert(keepers.begin(), options.run_dir);
  for (const std::filesystem::path& dir : keepers) {
    for (const std::string& sentence : UseKeptInputs(dir, &config.data))
      fmt::print(stderr, "{}\n", sentence);
  }
  const World& world = train_options.world;
  // Processes that LaunchProcesses has started have a store.
  if (options.processes > 1 && world.store.empty()) {
    if (world.size > 1) {
      throw ConfigError(
          "--nproc starts processes, but the environment has WORLD_SIZE: they were started "
          "already; leave one of the two out");
    }
    RequireProcesses(config, options.processes);
    return LaunchProcesses(options.processes, OwnCommand());
  }
  ChooseThreads(options.run_dir, IdleProcessors(), world.store.empty() ? 1 : world.size, &config);
  SetTorchThreads(config.run.threads);
  const TrainResult result = Train(config, train_options);
  return result.signal == 0 ? 0 : StatusOfSignal(result.signal);
}

int TrainMany(const TrainCommandOptions& options) {
  WaitPassively();
  std::vector<SweepRun> runs =
      ExpandSweep(ReadSweep(ConfigSource::FromFile(options.sweep)), options.assignments);
  const std::filesystem::path dir = options.run_dir;
  MakeFolder(dir);
  SaveStart(dir);
  const int idle = IdleProcessors();
  for (SweepRun& run : runs) ChooseThreads(dir / run.name, idle, 1, &run.config);
  const SweepResult result = TrainSweep(runs, options.run_dir, /*quiet=*/false);
  for (const std::string& failure : result.failures) fmt::print(stderr, "failed: {}\n", failure);
  const Table summary = CompareRuns(GroupRuns(ReadRuns({options.run_dir})));
  WriteFileAtomically(dir / "summary.csv", FormatTable(summary, TableFormat::kCsv));
  WriteFileAtomically(dir / "summary.json", FormatTable(summary, TableFormat::kJson));
  fmt::print("{}", FormatTable(summary, TableFormat::kText));
  if (!result.finished) fmt::print(stderr, "stopped: the same command continues the sweep\n");
  if (result.signal != 0) return StatusOfSignal(result.signal);
  return result.failures.empty() ? 0 : 2;
}

}  // namespace

Command AddTrainCommand(CLI::App& program) {
  auto options = std::make_shared<TrainCommandOptions>();
  CLI::App* app =
      program.add_subcommand("train", "Train the segmentation network on rendered samples");
  CLI::Option* config =
      app->add_option("--config", options->config, "recipe, e.g. configs/m05-lite.yaml");
  CLI::Option* sweep = app->add_option(
      "--sweep", options->sweep,
      "YAML of recipes, values and seeds: trains all combinations, one after the other, in folders "
      "of --output, and goes on where it was stopped");
  sweep->excludes(config);
  AddSettings(app, &options->assignments, "the recipe, e.g. run.samples=20000", "run.",
              "threads; 0: one for each idle processor");
  app->add_option("-o,--output,--run-dir", options->run_dir,
                  "folder for config, metrics and checkpoints")
      ->required();
  app->add_option("--nproc", options->processes,
                  "number of processes on this machine; each trains with its slice of the batch")
      ->check(CLI::Range(1, 1024))
      ->excludes(sweep);
  app->add_flag("--resume", options->resume, "continue the run in that folder")->excludes(sweep);
  return {app, [options] {
            if (!options->sweep.empty()) return TrainMany(*options);
            if (options->config.empty()) {
              throw ConfigError("train wants --config RECIPE.yaml or --sweep SWEEP.yaml");
            }
            return TrainOne(*options);
          }};
}

}  // namespace volalign

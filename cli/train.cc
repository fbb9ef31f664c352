#include <fmt/format.h>

#include <csignal>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "cli/options.h"
#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/interrupt.h"
#include "core/nn/cpu/torch_threads.h"
#include "train/compute.h"
#include "train/distributed/launch.h"
#include "train/log/run_log.h"
#include "train/log/run_table.h"
#include "train/sweep.h"
#include "train/together.h"
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

int TrainOne(const TrainCommandOptions& options) {
  WaitPassively();
  TrainOptions train_options;
  train_options.world = ReadWorld();
  train_options.run_dir = options.run_dir;
  train_options.resume = options.resume;
  const TrainConfig config = ReadTrainConfig(ReadSource(options.config, options.assignments));
  if (options.processes > 1) {
    if (train_options.world.size > 1) {
      throw ConfigError(
          "--nproc starts processes, and WORLD_SIZE says that somebody has done so already: leave "
          "one of them out");
    }
    RequireProcesses(config, options.processes);
    const int status = LaunchProcesses(options.processes, OwnCommandWithout("--nproc"));
    const bool stopped = status == StatusOfSignal(SIGINT) || status == StatusOfSignal(SIGTERM);
    if (status == 0 || stopped) SaveCommand(options.run_dir);
    return status;
  }
  SetTorchThreads(config.run.threads);
  KeepFreedMemory();
  const TrainResult result = Train(config, train_options);
  if (train_options.world.rank == 0) SaveCommand(options.run_dir);
  return result.signal == 0 ? 0 : StatusOfSignal(result.signal);
}

int TrainMany(const TrainCommandOptions& options) {
  WaitPassively();
  KeepFreedMemory();
  const std::vector<SweepRun> runs =
      ExpandSweep(ReadSweep(ConfigSource::FromFile(options.sweep)), options.assignments);
  const SweepResult result = TrainSweep(runs, options.run_dir, /*quiet=*/false);
  for (const std::string& failure : result.failures) fmt::print(stderr, "failed: {}\n", failure);
  const Table summary = CompareRuns(GroupRuns(ReadRuns({options.run_dir})));
  const std::filesystem::path dir = options.run_dir;
  WriteFileAtomically(dir / "summary.csv", FormatTable(summary, TableFormat::kCsv));
  WriteFileAtomically(dir / "summary.json", FormatTable(summary, TableFormat::kJson));
  SaveCommand(dir);
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
      "YAML of recipes, values and seeds: trains all combinations in folders of "
      "--output, those with the same samples side by side, and goes on where it was "
      "stopped");
  sweep->excludes(config);
  app->add_option("--set", options->assignments,
                  "KEY=VALUE over the recipe, e.g. run.samples=20000")
      ->take_all();
  AddAssignment(app, "--threads", "run.threads", &options->assignments, "threads; 0: one per core");
  AddAssignment(app, "--device", "run.device", &options->assignments, "cpu, cuda or cuda:N");
  app->add_option("-o,--output,--run-dir", options->run_dir,
                  "folder for config, metrics and checkpoints")
      ->required();
  app->add_option("--nproc", options->processes,
                  "train in so many processes on this machine, each with its slice of the batch")
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

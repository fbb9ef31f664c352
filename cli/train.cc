#include <fmt/format.h>

#include <memory>
#include <string>
#include <vector>

#include "cli/commands.h"
#include "cli/options.h"
#include "core/torch_threads.h"
#include "train/train_config.h"
#include "train/trainer.h"

namespace volalign {

Command AddTrainCommand(CLI::App& program) {
  struct Options {
    std::string config, run_dir;
    std::vector<std::string> assignments;
    bool resume = false;
  };
  auto options = std::make_shared<Options>();
  CLI::App* app =
      program.add_subcommand("train", "Train the segmentation network on rendered samples");
  app->add_option("--config", options->config, "recipe, e.g. configs/m05-lite.yaml")->required();
  app->add_option("--set", options->assignments,
                  "KEY=VALUE over the recipe, e.g. run.samples=20000")
      ->take_all();
  AddAssignment(app, "--threads", "run.threads", &options->assignments, "threads; 0: one a core");
  AddAssignment(app, "--device", "run.device", &options->assignments, "cpu, cuda or cuda:N");
  app->add_option("-o,--output,--run-dir", options->run_dir,
                  "folder for config, metrics and checkpoints")
      ->required();
  app->add_flag("--resume", options->resume, "continue the run in that folder");
  return {app, [options] {
            ConfigSource source = ConfigSource::FromFile(options->config);
            for (const std::string& assignment : options->assignments) source.Set(assignment);
            TrainOptions train_options;
            train_options.run_dir = options->run_dir;
            train_options.resume = options->resume;
            const TrainConfig config = ReadTrainConfig(source);
            SetTorchThreads(config.run.threads);
            Train(config, train_options);
            return 0;
          }};
}

}  // namespace volalign

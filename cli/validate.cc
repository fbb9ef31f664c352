#include <fmt/format.h>

#include <memory>
#include <string>
#include <vector>

#include "cli/commands.h"
#include "cli/options.h"
#include "core/checkpoint.h"
#include "core/torch_threads.h"
#include "train/checkpoint_validation.h"

namespace volalign {

Command AddValidateCommand(CLI::App& program) {
  struct Options {
    std::string model, config;
    std::vector<std::string> assignments;
    int samples = 1000;
  };
  auto options = std::make_shared<Options>();
  CLI::App* app =
      program.add_subcommand("validate", "Score a checkpoint on rendered validation samples");
  app->add_option("--model", options->model, "checkpoint")->required();
  app->add_option("--config", options->config,
                  "recipe that says what the samples are; the checkpoint's own without it");
  app->add_option("--set", options->assignments, "KEY=VALUE over the recipe")->take_all();
  AddAssignment(app, "--threads", "run.threads", &options->assignments, "threads; 0: one a core");
  AddAssignment(app, "--device", "run.device", &options->assignments, "cpu, cuda or cuda:N");
  app->add_option("--samples", options->samples, "number of samples, rounded up to whole batches")
      ->check(CLI::Range(1, 100000000))
      ->capture_default_str();
  return {app, [options] {
            LoadedModel model = LoadCheckpoint(options->model);
            ConfigSource source =
                options->config.empty()
                    ? ConfigSource::FromString(model.meta.config_yaml,
                                               options->model + " (its training configuration)")
                    : ConfigSource::FromFile(options->config);
            for (const std::string& assignment : options->assignments) source.Set(assignment);
            const TrainConfig config = ReadTrainConfig(source);
            SetTorchThreads(config.run.threads);
            const ValidationResult result = ValidateCheckpoint(model, config, options->samples);
            fmt::print("{}: {} training samples, validated on seed {}\n\n{}", options->model,
                       model.meta.samples, config.run.validation_seed, ValidationTable(result));
            return 0;
          }};
}

}  // namespace volalign

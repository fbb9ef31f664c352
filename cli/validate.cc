#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "cli/options.h"
#include "cli/table_output.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/base/progress_line.h"
#include "core/geometry/structure.h"
#include "core/nn/checkpoint.h"
#include "core/nn/cpu/torch_threads.h"
#include "train/checkpoint_validation.h"
#include "train/compute.h"
#include "train/run_inputs.h"

namespace volalign {

namespace {

struct ValidateOptions {
  std::vector<std::string> models;
  std::string config, output;
  std::vector<std::string> assignments;
  int samples = 1000;
  TableOutput table;
};

/// Adds the recipe of the samples to `recipes`.
ValidatedModel ValidateModel(const std::string& file, const ValidateOptions& options,
                             std::vector<std::pair<std::string, std::string>>* recipes) {
  LoadedModel model = LoadCheckpoint(file);
  ConfigSource source =
      options.config.empty()
          ? ConfigSource::FromString(model.meta.config_yaml, file + " (its training configuration)")
          : ConfigSource::FromFile(options.config);
  source.Set("run.threads=0");  // those of the training are another machine's
  for (const std::string& assignment : options.assignments) source.Set(assignment);
  TrainConfig config = ReadTrainConfig(source);
  const ConfigSource changes = ReadSource("", options.assignments);
  const auto asked = [&](const char* key) {
    return !options.config.empty() || changes.Find(key) != nullptr;
  };
  // Without a name, data.sensors stands for all sensors of the file.
  if (asked("data.intrinsics") || (asked("data.sensors") && config.data.sensors.empty()))
    model.meta.intrinsics.clear();
  // The run's file is for older checkpoints, and for sensors that the training did not have.
  const std::filesystem::path folder = std::filesystem::path(file).parent_path();
  if (const std::string kept = KeptIntrinsics(folder);
      !kept.empty() && std::filesystem::exists(folder / "config.yaml") && !asked("data.intrinsics"))
    config.data.intrinsics = kept;
  std::optional<Structure> structure;
  if (asked("data.structure")) {
    RequireInputFile("data.structure", config.data.structure);
    structure = ReadStructure(config.data.structure);
    if (structure->Hash() != model.meta.structure.Hash())
      options.table.Say(fmt::format("{}: trained on other boxes than those of data.structure = {}",
                                    file, config.data.structure));
  }
  recipes->emplace_back("recipe of " + file, WriteConfig(config));
  SetTorchThreads(config.run.threads > 0 ? config.run.threads : IdleProcessors());
  ProgressLine line;
  ValidatedModel validated{
      file, model.meta.samples,
      ValidateCheckpoint(model, config, options.samples, line.Counter("samples"),
                         structure ? &*structure : nullptr)};
  line.Stop();
  const bool recorded = !config.data.real.validation.empty();
  options.table.Say(fmt::format(
      "{}: {} training samples, validated on {}", file, model.meta.samples,
      recorded ? "recorded frames" : fmt::format("seed {}", config.run.validation_seed)));
  return validated;
}

}  // namespace

Command AddValidateCommand(CLI::App& program) {
  auto options = std::make_shared<ValidateOptions>();
  CLI::App* app = program.add_subcommand(
      "validate",
      "Score checkpoints on rendered validation samples, or on the frames of data.real.validation");
  app->add_option("--model", options->models, "checkpoints")->required();
  app->add_option("--config", options->config,
                  "recipe that says what the samples are; each checkpoint's own without it");
  AddSettings(app, &options->assignments, "the recipe", "run.",
              "threads; 0: one for each idle processor");
  app->add_option("--samples", options->samples, "number of samples, rounded up to whole batches")
      ->check(CLI::Range(1, 100000000))
      ->capture_default_str();
  app->add_option("-o,--output", options->output, "also write the scores to this file, JSON");
  options->table.AddOptions(app);
  return {app, [options] {
            std::vector<ValidatedModel> all;
            std::vector<std::pair<std::string, std::string>> recipes;
            for (const std::string& file : options->models)
              all.push_back(ValidateModel(file, *options, &recipes));
            const Table table = ValidationTable(all);
            options->table.Print(FormatTable(table, TableFormat::kText), table);
            if (!options->output.empty()) {
              WriteFileAtomically(options->output, ValidationJson(all));
              SaveCommand(options->output, recipes);
              options->table.Say("written: " + options->output);
            }
            return 0;
          }};
}

}  // namespace volalign

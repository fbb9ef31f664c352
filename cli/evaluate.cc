#include "infer/evaluate/evaluate.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "cli/load_segmenter.h"
#include "cli/options.h"
#include "cli/table_output.h"
#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/folder.h"
#include "core/base/input_file.h"
#include "core/base/progress_line.h"
#include "core/nn/cpu/torch_threads.h"
#include "infer/evaluate/statistics.h"
#include "infer/evaluate/suite/methods.h"
#include "infer/evaluate/suite/run_suite.h"
#include "infer/evaluate/suite/suite_config.h"

namespace volalign {

namespace {

struct EvaluateOptions {
  std::string output, config, seeds, compare;
  std::vector<std::string> models, captures, assignments;
  RigSeries rigs;
  RendererOptions renderer;
  std::string suite, suite_config = "configs/paper/suite.yaml";
  int workers = 1, max_captures = 0;
  TableOutput table;
};

void AddSuiteOptions(CLI::App* app, EvaluateOptions* options) {
  CLI::Option* suite =
      app->add_option("--suite", options->suite,
                      "run the experiments of one of the paper's tables (table2 ... table6) or all "
                      "of them, instead of rigs and captures of your own (docs/paper.md)");
  app->add_option("--suite-config", options->suite_config,
                  "YAML of the suite's captures, methods and tables")
      ->needs(suite)
      ->capture_default_str();
  app->add_option("--workers", options->workers, "captures that are worked on at the same time")
      ->needs(suite)
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  app->add_option("--max-captures", options->max_captures,
                  "number of captures of each dataset, evenly spaced; 0: all")
      ->needs(suite)
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
}

void AddEvaluateOptions(CLI::App* app, EvaluateOptions* options) {
  app->add_option("--model", options->models,
                  "checkpoints; several are compared on the same frames. Without it: the shipped "
                  "one (models/m05-lite.safetensors)");
  app->add_option("--rig,--rigs", options->rigs.files, "rig.yaml files, rendered in memory");
  app->add_option("--sensors", options->rigs.sensors,
                  "run each rig with each of these models for all its sensors, e.g. "
                  "azure_kinect_nfov_binned realsense_d415; without it, with the rig's own");
  app->add_option(
      "--seeds", options->seeds,
      "FIRST:END (END not included) or a list with commas. Without it: the seed of the rig");
  app->add_option("--capture,--captures", options->captures,
                  "capture.json files, scored by residuals and, where they have it, ground truth");
  app->add_option("--compare", options->compare,
                  "KEY=VALUE,VALUE: a calibration option. Each capture is calibrated with each "
                  "value, side by side");
  app->add_option("--config", options->config, "YAML of calibration options (docs/config.md)");
  AddSettings(app, &options->assignments, "the calibration options", "", "threads over sensors");
  app->add_option("--set-rig", options->rigs.changes, "KEY=VALUE: replaces a value of every rig")
      ->take_all();
  app->add_option(
         "--placements", options->rigs.placements,
         "numbers of placements of the structure, e.g. 1 2 4. Each rig is calibrated with so many "
         "captures: first those of the rig, then drawn ones. Without it: those of the rig")
      ->check(CLI::Range(1, 6));
  app->add_option("--placement-radius", options->rigs.placement_radius_m,
                  "largest distance of drawn placements from the first, m")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app->add_flag("--keep-yaw", options->rigs.keep_yaw,
                "leave the structure as the rig turns it; else each seed turns it by the golden "
                "angle more");
  options->renderer.AddTo(app);
  AddSuiteOptions(app, options);
  options->table.AddOptions(app);
  // A suite writes all of its tables into suite.json.
  for (const char* format : {"--json", "--csv"}) app->get_option(format)->excludes("--suite");
  app->add_option("-o,--output", options->output,
                  "folder for evaluation.json, of which what a killed run left is not done again, "
                  "or for the suite's tables")
      ->required();
}

EvaluateRun RunOf(const EvaluateOptions& options, ProgressLine* line) {
  EvaluateRun run;
  run.output = std::filesystem::path(options.output) / "evaluation.json";
  run.program = Sha256(ReadFile("/proc/self/exe", kMaxModelBytes));
  run.progress = [line](const std::string& text) { line->Say(text); };
  run.count = line->Counter("captures");
  return run;
}

/// Writes the resolved options beside the result: those of calibration, without --compare, and each
/// rig.
void SaveOptions(const ResultFolder& folder, const ConfigSource& source,
                 const std::vector<NamedRig>& rigs) {
  const std::filesystem::path& draft = folder.draft();
  WriteFileAtomically(draft / "options.yaml", WriteConfig(ReadConfig<CalibrateOptions>(source)));
  for (const NamedRig& rig : rigs)
    WriteFileAtomically(draft / "rigs" / (rig.name + ".yaml"), WriteConfig(rig.rig));
  folder.Publish("options.yaml", {"command.yaml"});
}

/// Are all models of the suite there? Names the missing ones. Throws IoError if none is there.
bool HasItsModels(const SuiteConfig& suite) {
  std::vector<std::string> missing;
  bool any = false;
  for (const SuiteMethod& method : suite.methods) {
    if (method.model.empty()) continue;
    any = any || HasModel(method);
    if (!HasModel(method)) missing.push_back(fmt::format("{} ({})", method.name, method.model));
  }
  if (missing.empty()) return true;
  const std::string said =
      fmt::format("neither the working directory nor the data folder '{}' has the models of {}",
                  DataFolder(), fmt::join(missing, ", "));
  if (!any) throw IoError(said);
  fmt::print(stderr, "{}: their rows stay empty\n", said);
  return false;
}

/// Returns the exit status: 2 if rows stay empty.
int RunPaperSuite(const EvaluateOptions& options) {
  const SuiteConfig suite = SelectTables(ReadSuite(options.suite_config), options.suite);
  const bool complete = HasItsModels(suite);
  const ResultFolder folder(options.output);
  SuiteRun run;
  run.output = options.output;
  run.workers = options.workers;
  run.make_renderer = [&options] { return options.renderer.Choose().make(); };
  run.max_captures = options.max_captures;
  ProgressLine line;
  run.progress = [&line](const std::string& text) { line.Say(text); };
  run.count = line.Counter("captures");
  SetTorchThreads(options.workers > 1 ? 1 : 2);
  const std::string tables = WriteSuite(folder.draft(), suite, RunSuite(suite, run));
  SaveCommand(folder.draft(), {{"suite", WriteConfig(suite)}});
  folder.Publish("suite.json");
  line.Stop();
  fmt::print("{}", tables);
  fmt::print(stderr, "written: {}/suite.md, suite.json, and a JSON of each table\n",
             options.output);
  return complete ? 0 : 2;
}

int RunEvaluate(const EvaluateOptions& options) {
  if (!options.suite.empty()) return RunPaperSuite(options);
  if (options.rigs.files.empty() && options.captures.empty()) {
    throw ConfigError("evaluate wants --rig RIG.yaml ..., --capture capture.json ..., or both");
  }
  const ConfigSource source = ReadSource(options.config, options.assignments);
  const std::vector<EvaluationVariant> variants = ReadVariants(source, options.compare);
  RigSeries series = options.rigs;
  const std::vector<NamedRig> rigs = ReadRigs(series);
  if (!options.seeds.empty()) series.seeds = ParseSeeds(options.seeds);

  const ResultFolder folder(options.output);
  RemoveTemporaries(folder.dir());
  const CalibrateOptions& first = variants.front().options;
  std::vector<std::unique_ptr<NetworkSegmenter>> networks;
  std::vector<EvaluationModel> models;
  const std::vector<std::string> files =
      options.models.empty() ? std::vector<std::string>{kShippedModel} : options.models;
  for (const std::string& file : files) {
    networks.push_back(LoadSegmenter(file, nullptr, first.device, first.threads));
    NetworkSegmenter* network = networks.back().get();
    models.push_back({{network->file(), network->sha256()}, network, &network->structure()});
  }
  std::unique_ptr<DepthRenderer> renderer;
  std::vector<EvaluationItem> items;
  if (!rigs.empty()) {
    const Renderers chosen = options.renderer.Choose();
    fmt::print(stderr, "renderer: {}\n", chosen.description);
    renderer = chosen.make();
    items = RigItems(rigs, series, renderer.get());
  }
  for (const std::string& capture : options.captures) {
    items.push_back(CaptureItem(capture, networks.front()->structure()));
  }
  ProgressLine line;
  EvaluateRun run = RunOf(options, &line);
  run.begin = [&] { SaveOptions(folder, source, rigs); };
  const std::vector<EvaluatedCase> cases = Evaluate(items, variants, models, run);
  line.Stop();
  options.table.Print(FormatEvaluation(cases), EvaluationTable(cases));
  SaveCommand(options.output);
  fmt::print(stderr, "written: {}\n", run.output.string());
  return 0;
}

}  // namespace

Command AddEvaluateCommand(CLI::App& program) {
  auto options = std::make_shared<EvaluateOptions>();
  CLI::App* app = program.add_subcommand(
      "evaluate", "Measure calibration on rendered rigs with known poses, or on captures");
  AddEvaluateOptions(app, options.get());
  return {app, [options] { return RunEvaluate(*options); }};
}

}  // namespace volalign

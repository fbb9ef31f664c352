#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "cli/options.h"
#include "cli/table_output.h"
#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/folder.h"
#include "core/base/input_file.h"
#include "core/base/progress_line.h"
#include "render/capture_writer.h"
#include "render/dataset.h"
#include "render/rig.h"
#include "render/sample.h"
#include "train/run_inputs.h"
#include "train/train_config.h"

namespace volalign {

namespace {

struct RenderOptions {
  std::string rig, config, output;
  std::vector<std::string> assignments;
  std::optional<std::uint64_t> seed;
  std::uint64_t index = 0;
  std::uint64_t count = 24;
  int threads = 0;
  bool force = false;
  RendererOptions renderer;
  TableOutput table;
};

void AddOptions(RenderOptions* options, CLI::App* app) {
  CLI::Option* rig =
      app->add_option("--rig", options->rig, "rig.yaml: write one capture with ground truth");
  app->add_option("--config", options->config,
                  "training recipe: write samples as training sees them; continues an "
                  "interrupted run")
      ->excludes(rig);
  AddSet(app, &options->assignments, "the rig or recipe");
  app->add_option("-o,--output", options->output, "folder to write")->required();
  app->add_option("--index", options->index, "first sample")->excludes(rig);
  app->add_option("--count", options->count, "number of samples")
      ->check(CLI::Range(1, 1000000000))
      ->excludes(rig);
  app->add_option("--seed", options->seed,
                  "seed of the samples. Without it: run.seed of the recipe")
      ->excludes(rig);
  app->add_option("--threads", options->threads,
                  "threads that render, and as many that compress; 0: one per core")
      ->check(CLI::Range(0, 1024))
      ->excludes(rig);
  app->add_flag("--force", options->force, "replace the capture that the folder has")->needs(rig);
  options->renderer.AddTo(app);
  options->table.AddOptions(app);
  for (const char* format : {"--json", "--csv"}) app->get_option(format)->needs(rig);
}

/// Writes each of several captures as a capture of its own into `draft`, which becomes `output`,
/// and adds a row for each frame to `table`. Returns the names of the captures.
std::vector<std::string> WriteCaptures(const std::filesystem::path& draft,
                                       const std::string& output,
                                       const std::vector<RigCapture>& captures,
                                       const std::string& renderer, Table* table) {
  std::vector<std::string> written;
  for (std::size_t k = 0; k < captures.size(); ++k) {
    const std::string name = captures.size() > 1 ? fmt::format("placement_{}", k + 1) : "";
    WriteCapture(draft / name, captures[k], renderer);
    const std::string capture = (std::filesystem::path(output) / name / "capture.json").string();
    written.push_back(capture);
    for (const CapturedSensor& sensor : captures[k].sensors) {
      const Eigen::Vector3d p = sensor.structure_from_sensor.translation();
      const auto on_stack = std::count_if(sensor.labels.begin(), sensor.labels.end(),
                                          [](std::uint8_t label) { return label > 0; });
      table->rows.push_back({capture, sensor.name, sensor.sensor, CellOf(sensor.intrinsics.width),
                             CellOf(sensor.intrinsics.height), p.x(), p.y(), p.z(),
                             std::int64_t{on_stack}});
    }
  }
  return written;
}

/// Does the folder have a capture of its own, or those of placements or turns?
bool HasCapture(const std::filesystem::path& folder) {
  const auto exists = [&](const char* part) {
    std::error_code error;
    return std::filesystem::exists(folder / part / "capture.json", error);
  };
  return exists("") || exists("placement_1") || exists("turn_1");
}

/// Renders each of several turns of the structure into a folder of its own.
void RenderRigTurns(const RenderOptions& options, const ConfigSource& source,
                    const Renderers& renderers) {
  if (!options.force && HasCapture(options.output)) {
    throw ConfigError(fmt::format("{} has a capture already; --force replaces it", options.output));
  }
  const ResultFolder folder(options.output);
  const std::unique_ptr<DepthRenderer> renderer = renderers.make();
  const std::vector<Rig> turns = Turns(ReadRig(source));
  Table table;
  table.columns = {"capture",
                   "sensor",
                   "kind",
                   {"width_px", "width"},
                   {"height_px", "height"},
                   {"x_m", "x, m", 1, 3},
                   {"y_m", "y, m", 1, 3},
                   {"z_m", "z, m", 1, 3},
                   {"structure_px", "pixels on the structure"}};
  std::vector<std::string> written;
  ProgressLine line;
  for (std::size_t k = 0; k < turns.size(); ++k) {
    const std::string of =
        turns.size() > 1 ? fmt::format(" of turn {} of {}", k + 1, turns.size()) : "";
    std::filesystem::path draft = folder.draft(), output = options.output;
    if (turns.size() > 1) {
      draft /= fmt::format("turn_{}", k + 1);
      output /= draft.filename();
    }
    const std::vector<RigCapture> captures =
        RenderPlacements(turns[k], *renderer, nullptr, line.Counter("frames" + of));
    WriteFileAtomically(draft / "rig.yaml", WriteConfig(turns[k]));
    for (const std::string& capture :
         WriteCaptures(draft, output.string(), captures, renderers.description, &table)) {
      written.push_back(capture);
    }
  }
  SaveCommand(folder.draft());
  folder.Publish("capture.json");
  line.Stop();
  options.table.Print(FormatTable(table, TableFormat::kText), table);
  options.table.Say(
      fmt::format("written: {}, each with a contact_sheet.png", fmt::join(written, ", ")));
}

void RenderDataset(const RenderOptions& options, const TrainConfig& recipe, std::uint64_t seed,
                   const RendererFactory& make_renderer) {
  DatasetOptions dataset;
  dataset.seed = seed;
  dataset.first_index = options.index;
  dataset.count = options.count;
  dataset.num_threads = options.threads > 0
                            ? options.threads
                            : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  dataset.make_renderer = make_renderer;
  dataset.progress = true;
  const auto context =
      std::make_shared<const SampleContext>(MakeSampleContext(recipe.data, recipe.run.batch_size));
  const DatasetResult result = WriteDataset(options.output, context, dataset);
  fmt::print("written: {} samples", result.written);
  if (result.found > 0) fmt::print(" after {} that were there", result.found);
  fmt::print(" to {}/index.json: {} from index {} of seed {}; contact_sheet.png\n", options.output,
             options.count, options.index, seed);
}

int RunRender(const RenderOptions& options) {
  if (options.rig.empty() == options.config.empty()) {
    throw ConfigError(
        "render wants --rig RIG.yaml for a capture, or --config RECIPE.yaml for samples");
  }
  const ConfigSource source =
      ReadSource(options.rig.empty() ? options.config : options.rig, options.assignments);
  const auto choose = [&](RendererKind kind) {
    Renderers chosen = options.renderer.Choose(kind);
    options.table.Say("renderer: " + chosen.description);
    return chosen;
  };
  if (!options.rig.empty()) {
    RenderRigTurns(options, source, choose(RendererKind::kEgl));
    return 0;
  }
  TrainConfig recipe = ReadTrainConfig(source);
  const std::filesystem::path folder =
      std::filesystem::path(FindInputFile(options.config)).parent_path();
  for (const std::string& sentence : UseKeptInputs(folder, &recipe.data))
    options.table.Say(sentence);
  const Renderers chosen = choose(recipe.data.renderer);
  recipe.data.renderer = chosen.kind;
  const std::uint64_t seed = options.seed.value_or(static_cast<std::uint64_t>(recipe.run.seed));
  RenderDataset(options, recipe, seed, chosen.make);
  SaveCommand(options.output, {{"recipe", WriteConfig(recipe)}});
  return 0;
}

}  // namespace

Command AddRenderCommand(CLI::App& program) {
  auto options = std::make_shared<RenderOptions>();
  CLI::App* app = program.add_subcommand(
      "render", "Render a multi-sensor capture, or a dataset of training samples");
  AddOptions(options.get(), app);
  return {app, [options] { return RunRender(*options); }};
}

}  // namespace volalign

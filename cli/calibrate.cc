#include "infer/calibrate.h"

#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/commands.h"
#include "core/config.h"
#include "core/file_util.h"
#include "core/structure_gltf.h"
#include "core/torch_threads.h"
#include "infer/io/capture.h"
#include "infer/io/export.h"
#include "infer/io/report.h"
#include "infer/view/segmenter.h"

namespace volalign {

namespace {

struct Options {
  std::string capture, model, output, config, structure, initial, estimate;
  std::vector<std::string> assignments;
};

void AddOptions(CLI::App* app, Options* options) {
  app->add_option("--capture", options->capture, "capture.json")->required();
  app->add_option("--model", options->model, "checkpoint, e.g. models/m05-lite.pt")->required();
  app->add_option("-o,--output", options->output, "folder for poses, pictures and clouds")
      ->required();
  app->add_option(
      "--structure", options->structure,
      "structure with other dimensions than the capture's or the model's (.glb or .yaml)");
  app->add_option("--initial", options->initial,
                  "initial pose: robust (default) or paper (the paper's estimator)")
      ->check(CLI::IsMember({"robust", "paper"}));
  app->add_option("--estimate", options->estimate,
                  "beside the poses: auto (the default), none, or a list of boxes, size, "
                  "depth_gain, depth_offset; refine.estimate of the config");
  app->add_option("--config", options->config, "YAML of calibration options (docs/config.md)");
  app->add_option("--set", options->assignments, "KEY=VALUE over the config, e.g. refine.threads=1")
      ->take_all();
}

CalibrateOptions Resolve(const Options& options) {
  ConfigSource source =
      options.config.empty() ? ConfigSource() : ConfigSource::FromFile(options.config);
  for (const std::string& assignment : options.assignments) source.Set(assignment);
  if (!options.initial.empty()) source.Set("initial.method=" + options.initial);
  if (!options.estimate.empty()) source.Set("refine.estimate=" + options.estimate);
  return ReadConfig<CalibrateOptions>(source);
}

/// --structure, else the capture's; none: the model's own serves.
std::optional<Structure> GivenStructure(const Options& options, const Capture& capture) {
  if (!options.structure.empty()) return ReadStructure(options.structure);
  if (capture.structure) return ReadStructure(*capture.structure);
  return std::nullopt;
}

int RunCalibrate(const Options& options) {
  const CalibrateOptions config = Resolve(options);

  const auto start = std::chrono::steady_clock::now();
  const Capture capture = ReadCapture(options.capture);
  std::optional<Structure> structure = GivenStructure(options, capture);
  SetTorchThreads(config.threads);
  const std::unique_ptr<NetworkSegmenter> segmenter =
      LoadNetworkSegmenter(options.model, structure ? &*structure : nullptr);
  if (!structure) structure = segmenter->structure();
  const std::chrono::duration<double> loading = std::chrono::steady_clock::now() - start;

  PrepareFolder(options.output);
  CalibrationResult result = Calibrate(capture.sensors, *structure, *segmenter, config);
  result.timings_s.back().second += loading.count();
  result.timings_s.insert(result.timings_s.begin(), {"load", loading.count()});
  WriteFileAtomically(std::filesystem::path(options.output) / "options.yaml", WriteConfig(config));
  WriteCalibration(options.output, result, capture.sensors, *structure,
                   {options.capture, segmenter->file(), segmenter->sha256()});
  fmt::print("{}", FormatReport(result));
  fmt::print(
      "written: {}/extrinsics.json, options.yaml, labels/, confidence/, pictures/, clouds/\n",
      options.output);
  return result.placed() == static_cast<int>(result.sensors.size()) ? 0 : 2;
}

}  // namespace

Command AddCalibrateCommand(CLI::App& program) {
  auto options = std::make_shared<Options>();
  CLI::App* app = program.add_subcommand("calibrate", "Find the poses of a capture's sensors");
  AddOptions(app, options.get());
  return {app, [options] { return RunCalibrate(*options); }};
}

}  // namespace volalign

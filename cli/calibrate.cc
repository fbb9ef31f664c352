#include "infer/calibrate.h"

#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/commands.h"
#include "core/config.h"
#include "core/error.h"
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
  std::vector<std::string> captures;
  std::string model, output, config, structure, initial, estimate;
  std::vector<std::string> assignments;
};

void AddOptions(CLI::App* app, Options* options) {
  app->add_option(
         "--capture", options->captures,
         "capture.json; several, of the same sensors, where the stack was moved between them: "
         "poses are in the frame of the stack in the first")
      ->required();
  app->add_option("--model", options->model,
                  "checkpoint, e.g. models/m05-lite.pt; without it, poses come from the shape of "
                  "the structure alone, whatever its boxes");
  app->add_option("-o,--output", options->output, "folder for poses, pictures and clouds")
      ->required();
  app->add_option(
      "--structure", options->structure,
      "the structure (.glb or .yaml), where neither the capture nor the model has it, or has other "
      "dimensions");
  app->add_option("--initial", options->initial,
                  "what initial poses come from: network, geometry, auto (the default: geometry, "
                  "and the network where there is a model), or paper (the paper's estimator)")
      ->check(CLI::IsMember({"auto", "network", "geometry", "paper"}));
  app->add_option("--estimate", options->estimate,
                  "beside the poses: auto (the default), none, or a list of boxes, size, "
                  "depth_gain, depth_offset, lens; refine.estimate of the config");
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

/// --structure, else the captures'; none: the model's own serves. Throws ConfigError where captures
/// name different ones.
std::optional<Structure> GivenStructure(const Options& options,
                                        const std::vector<Capture>& captures) {
  if (!options.structure.empty()) return ReadStructure(options.structure);
  std::optional<Structure> structure;
  for (const Capture& capture : captures) {
    if (!capture.structure) continue;
    Structure read = ReadStructure(*capture.structure);
    if (structure && structure->Hash() != read.Hash()) {
      throw ConfigError(fmt::format(
          "{} has another structure than the captures before it; give the one with --structure",
          capture.path.string()));
    }
    structure = std::move(read);
  }
  return structure;
}

int RunCalibrate(const Options& options) {
  const CalibrateOptions config = Resolve(options);

  const auto start = std::chrono::steady_clock::now();
  std::vector<Capture> captures;
  for (const std::string& capture : options.captures) captures.push_back(ReadCapture(capture));
  std::optional<Structure> structure = GivenStructure(options, captures);
  const std::vector<Still> stills = StillsOf(std::move(captures));
  SetTorchThreads(config.threads);
  std::unique_ptr<NetworkSegmenter> segmenter;
  if (!options.model.empty())
    segmenter = LoadNetworkSegmenter(options.model, structure ? &*structure : nullptr);
  if (!structure && !segmenter) {
    throw ConfigError(
        "there is neither a model nor a structure; describe the boxes in a YAML and give it with "
        "--structure");
  }
  if (!structure) structure = segmenter->structure();
  const std::chrono::duration<double> loading = std::chrono::steady_clock::now() - start;

  PrepareFolder(options.output);
  CalibrationResult result = Calibrate(stills, *structure, segmenter.get(), config);
  result.timings_s.back().second += loading.count();
  result.timings_s.insert(result.timings_s.begin(), {"load", loading.count()});
  WriteFileAtomically(std::filesystem::path(options.output) / "options.yaml", WriteConfig(config));
  WriteCalibration(
      options.output, result, stills, *structure,
      {options.captures, segmenter ? segmenter->file() : "", segmenter ? segmenter->sha256() : ""});
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

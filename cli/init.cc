#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <string>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/base/progress_line.h"
#include "core/geometry/structure.h"
#include "infer/capture/capture_draft.h"

namespace volalign {

namespace {

struct InitOptions {
  std::string folder, output, intrinsics, sensor, structure;
  double depth_scale = 0;
  bool force = false;
};

int RunInit(const InitOptions& options) {
  namespace fs = std::filesystem;
  const fs::path output =
      options.output.empty() ? fs::path(options.folder) / "capture.json" : fs::path(options.output);
  if (fs::exists(output) && !options.force && !IsAsWritten(output)) {
    throw ConfigError(
        output.string() +
        " exists and was changed since `volalign init` wrote it; --force replaces it");
  }
  CaptureDraftOptions draft_options;
  if (options.depth_scale > 0) draft_options.depth_scale = options.depth_scale;
  if (options.intrinsics == "typical") {
    draft_options.typical = true;
  } else if (!options.intrinsics.empty()) {
    draft_options.intrinsics = options.intrinsics;
  }
  if (!options.structure.empty()) {
    ReadStructure(options.structure);
    draft_options.structure = FindInputFile(options.structure);
  }
  draft_options.sensor = options.sensor;
  const fs::path parent = output.has_parent_path() ? output.parent_path() : fs::path(".");
  ProgressLine line;
  line.Begin("looking at " + options.folder);
  const CaptureDraft draft = DraftCapture(options.folder, parent, draft_options);
  line.Stop();
  WriteFileAtomically(output, draft.json);
  SaveCommand(output);
  for (const std::string& sentence : draft.found) fmt::print("{}\n", sentence);
  fmt::print("written: {} ({} sensor{})\n", output.string(), draft.sensors,
             draft.sensors == 1 ? "" : "s");
  if (draft.unknown.empty()) return 0;
  fmt::print("\nnot known; add these before calibrating ({} has the keys):\n",
             WithPages("docs/formats.md"));
  for (const std::string& sentence : draft.unknown) fmt::print("- {}\n", sentence);
  return 2;
}

}  // namespace

Command AddInitCommand(CLI::App& program) {
  auto options = std::make_shared<InitOptions>();
  CLI::App* app =
      program.add_subcommand("init",
                             "Write a capture.json from a folder of depth files or recordings, or "
                             "of one folder per sensor; "
                             "says what it could not know, and then exits with status 2");
  app->add_option("folder", options->folder, "folder of the depth files or recordings")->required();
  app->add_option("--depth-scale", options->depth_scale,
                  "metres per unit of depth files: 0.001 for millimetres, 0.0001 for RealSense's "
                  "100 um, 1 for metres; a recording states its own")
      ->check(CLI::PositiveNumber);
  app->add_option(
      "--intrinsics", options->intrinsics,
      "file of intrinsics for sensors that have none of their own. typical: those of "
      "configs/intrinsics.yaml for the kind that --sensor names; all poses are then weak");
  app->add_option("--structure", options->structure,
                  "the structure that the sensors see (.yaml or a mesh), for `calibrate`");
  app->add_option("--sensor", options->sensor,
                  "kind of the devices, a name of configs/intrinsics.yaml, e.g. "
                  "azure_kinect_nfov_binned. It decides which lens is assumed");
  app->add_option("-o,--output", options->output, "file to write; FOLDER/capture.json without it");
  app->add_flag("--force", options->force,
                "replace a file that was changed since `volalign init` wrote it");
  return {app, [options] { return RunInit(*options); }};
}

}  // namespace volalign

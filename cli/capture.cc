#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <string>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "core/base/error.h"
#include "core/base/file_util.h"
#include "infer/capture/capture_draft.h"

namespace volalign {

namespace {

struct CaptureOptions {
  std::string folder, output, intrinsics, sensor;
  double depth_scale = 0;
  bool force = false;
};

int RunInit(const CaptureOptions& options) {
  namespace fs = std::filesystem;
  const fs::path output =
      options.output.empty() ? fs::path(options.folder) / "capture.json" : fs::path(options.output);
  if (fs::exists(output) && !options.force)
    throw ConfigError(output.string() + " is there already; --force replaces it");
  CaptureDraftOptions draft_options;
  if (options.depth_scale > 0) draft_options.depth_scale = options.depth_scale;
  if (!options.intrinsics.empty()) draft_options.intrinsics = options.intrinsics;
  draft_options.sensor = options.sensor;
  const fs::path parent = output.has_parent_path() ? output.parent_path() : fs::path(".");
  const CaptureDraft draft = DraftCapture(options.folder, parent, draft_options);
  WriteFileAtomically(output, draft.json);
  SaveCommand(output);
  for (const std::string& sentence : draft.found) fmt::print("{}\n", sentence);
  fmt::print("written: {} ({} sensors)\n", output.string(), draft.sensors);
  if (draft.unknown.empty()) return 0;
  fmt::print("\nnot known; add these before calibrating (docs/formats.md has the keys):\n");
  for (const std::string& sentence : draft.unknown) fmt::print("- {}\n", sentence);
  return 2;
}

}  // namespace

Command AddCaptureCommand(CLI::App& program) {
  auto options = std::make_shared<CaptureOptions>();
  CLI::App* app = program.add_subcommand("capture", "Make a capture.json from depth files");
  app->require_subcommand(1);
  CLI::App* init = app->add_subcommand(
      "init",
      "Write a capture.json from a folder of depth files or recordings, or of one folder a sensor; "
      "says what it could not know, and then exits with status 2");
  init->add_option("folder", options->folder, "folder of the depth files or recordings")
      ->required();
  init->add_option("--depth-scale", options->depth_scale,
                   "metres per unit of depth files: 0.001 for millimetres, 0.0001 for RealSense's "
                   "100 um, 1 for metres; a recording states its own")
      ->check(CLI::PositiveNumber);
  init->add_option("--intrinsics", options->intrinsics,
                   "file of intrinsics for the sensors that have none of their own");
  init->add_option("--sensor", options->sensor,
                   "kind of the devices, a name of configs/intrinsics.yaml, e.g. "
                   "azure_kinect_nfov_binned: what lens their frames have");
  init->add_option("-o,--output", options->output, "file to write; FOLDER/capture.json without it");
  init->add_flag("--force", options->force, "replace an existing file");
  return {app, [options] { return RunInit(*options); }};
}

}  // namespace volalign

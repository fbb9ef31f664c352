#include <fmt/format.h>
#include <fmt/ranges.h>

#include <memory>
#include <string>
#include <vector>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "core/base/error.h"
#include "core/base/folder.h"
#include "infer/formats/kinect_calibration.h"
#include "infer/report/pose_format.h"

namespace volalign {

namespace {

struct ConvertOptions {
  std::string input, from = "volalign", to, output;
  std::vector<std::string> colour_cameras;
  std::string camera = "depth", poses_for = "corrected";
  WorldChoice world;
};

/// Words of the formats that are written, or read.
std::string Formats(bool read) {
  std::vector<std::string> words;
  for (const std::string& word : PoseFormats()) {
    if (read ? IsReadable(word) : word != kVolalignPoses) words.push_back(word);
  }
  return fmt::format("{}", fmt::join(words, ", "));
}

ColourCameras ReadColourCameras(const std::vector<std::string>& assignments) {
  ColourCameras cameras;
  for (const std::string& assignment : assignments) {
    const std::size_t equals = assignment.find('=');
    if (equals == std::string::npos || equals == 0)
      throw ConfigError(fmt::format("--colour-camera {}: expected SENSOR=FILE.json", assignment));
    cameras[assignment.substr(0, equals)] = ReadKinectColour(assignment.substr(equals + 1));
  }
  return cameras;
}

int RunConvert(const ConvertOptions& options) {
  const std::string &to = options.to, &from = options.from;
  const bool is_folder = IsFolder(to);  // an unknown word is an error before anything is read
  const auto poses = ReadPoses(options.input, from, ReadColourCameras(options.colour_cameras));
  WorldChoice world = options.world;
  world.colour = options.camera == "colour";
  world.raw = options.poses_for == "raw";
  if (world.raw && from != kVolalignPoses) {
    throw ConfigError(
        "--poses-for raw needs an extrinsics.json: other files do not say where the structure is");
  }
  ReadWorld(options.input, from, &world);
  std::vector<std::string> notes;
  if (is_folder) {
    const ResultFolder folder(options.output);
    notes = WritePoses(folder.draft(), to, poses, world);
    SaveCommand(folder.draft());
    folder.Publish("command.yaml");
  } else {
    notes = WritePoses(options.output, to, poses, world);
    SaveCommand(options.output);
  }
  for (const std::string& note : notes) fmt::print("note: {}\n", note);
  fmt::print("written: {} ({} sensor{})\n", options.output, poses.size(),
             poses.size() == 1 ? "" : "s");
  return 0;
}

}  // namespace

Command AddConvertCommand(CLI::App& program) {
  auto options = std::make_shared<ConvertOptions>();
  CLI::App* app = program.add_subcommand(
      "convert",
      "Write poses as other programs read them (docs/conversion.md has the conventions of each)");
  app->add_option("input", options->input,
                  "extrinsics.json of `volalign calibrate`, or its folder, or what --from names")
      ->required();
  app->add_option("--to", options->to, "format to write: " + Formats(false))->required();
  app->add_option("--from", options->from, "format of the input: " + Formats(true))
      ->capture_default_str();
  app->add_option("-o,--output", options->output,
                  "file to write; a folder for colmap, depth_correction, volumetric_capture and "
                  "livescan3d_...")
      ->required();
  app->add_option("--origin", options->world.origin,
                  "of the written poses: structure, floor (the point of the floor below the "
                  "structure's origin), world (that of `calibrate --world`) or a sensor's name. "
                  "Without it: world if there is one, else structure");
  app->add_option(
         "--up", options->world.up,
         "axis that is up; without it what the format has, or, where a sensor is the origin, "
         "that sensor's own axes")
      ->check(CLI::IsMember({"y", "z"}));
  app->add_option("--camera", options->camera, "whose poses and intrinsics are written")
      ->check(CLI::IsMember({"depth", "colour"}))
      ->capture_default_str();
  app->add_option("--poses-for", options->poses_for,
                  "the depths that the poses fit: corrected by depth_gain and depth_offset_m, or "
                  "raw, for a program that corrects nothing")
      ->check(CLI::IsMember({"corrected", "raw"}))
      ->capture_default_str();
  app->add_option(
      "--frame", options->world.frame,
      "names the world in ros, ros_launch and urdf, for example robot_base. Without it, --origin "
      "names it");
  app->add_option(
         "--colour-camera", options->colour_cameras,
         "SENSOR=FILE: raw calibration JSON of that Azure Kinect. It says where the colour camera "
         "is. --camera colour and livescan3d_azure need it unless the input has it")
      ->take_all();
  return {app, [options] { return RunConvert(*options); }};
}

}  // namespace volalign

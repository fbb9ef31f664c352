#include <fmt/format.h>

#include <memory>
#include <string>

#include "cli/commands.h"
#include "infer/io/poses/pose_format.h"

namespace volalign {

Command AddConvertCommand(CLI::App& program) {
  struct Options {
    std::string input, from = "volalign", to, output;
  };
  auto options = std::make_shared<Options>();
  CLI::App* app = program.add_subcommand(
      "convert",
      "Write poses as other programs read them (docs/conversion.md has the conventions of each)");
  app->add_option("input", options->input,
                  "extrinsics.json of `volalign calibrate`, or what --from names")
      ->required();
  const std::string words =
      "poses, open3d, open3d_log, colmap, opencv, ros, unity, volumetric_capture, tum, csv";
  app->add_option("--to", options->to, "format to write: " + words)->required();
  app->add_option("--from", options->from, "format of the input: volalign, " + words)
      ->capture_default_str();
  app->add_option("-o,--output", options->output,
                  "file to write; a folder for colmap and volumetric_capture")
      ->required();
  return {app, [options] {
            const PoseFormat to = ParsePoseFormat(options->to);
            const auto poses = ReadPoses(options->input, ParsePoseFormat(options->from));
            for (const std::string& lost : WritePoses(options->output, to, poses))
              fmt::print("note: {}\n", lost);
            fmt::print("written: {} ({} sensors)\n", options->output, poses.size());
            return 0;
          }};
}

}  // namespace volalign

#include <fmt/format.h>

#include <memory>
#include <string>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "core/base/file_util.h"
#include "core/formats/structure_gltf.h"
#ifdef VOLALIGN_HAS_INFER
#include "infer/plan/target_report.h"
#endif

namespace volalign {

namespace {

void PrintStructure(const Structure& structure) {
  fmt::print("{}: {} boxes, {} labels and background, {:.0f} mm high, sha256 {}\n",
             structure.name(), structure.boxes().size(), structure.num_classes() - 1,
             structure.Height() * 1e3, structure.Hash().substr(0, 16));
  fmt::print("{:>5}  {:<24} {:>28}  {:>28}  {:>9}\n", "label", "side", "centre, mm",
             "exposed centroid, mm", "exposed");
  for (int label = 1; label < structure.num_classes(); ++label) {
    const Side& side = structure.SideOfLabel(label);
    const Eigen::Vector3d c = side.centre * 1e3, e = side.exposed_centroid * 1e3;
    fmt::print("{:>5}  {:<24} {:>8.1f} {:>9.1f} {:>9.1f}  {:>8.1f} {:>9.1f} {:>9.1f}  {:>7.0f} %\n",
               label, side.name, c.x(), c.y(), c.z(), e.x(), e.y(), e.z(),
               100 * side.exposed_area / (4 * side.half_u * side.half_v));
  }
}

#ifdef VOLALIGN_HAS_INFER
void CheckStructure(const std::string& file, const TargetViewOptions& views,
                    const std::string& picture) {
  const Structure structure = ReadStructure(file);
  const TargetQuality quality = MeasureTarget(structure, views);
  fmt::print("{}", FormatTarget(structure, quality));
  if (picture.empty()) return;
  WriteFileAtomically(picture, TargetPicture(structure, quality));
  SaveCommand(picture);
  fmt::print("written: {}\n", picture);
}
#endif

}  // namespace

Command AddStructureCommand(CLI::App& program) {
  struct Options {
    std::string boxes, glb, show, check, picture;
#ifdef VOLALIGN_HAS_INFER
    TargetViewOptions views;
#endif
  };
  auto options = std::make_shared<Options>();
  CLI::App* app = program.add_subcommand("structure", "Build or show the structure of boxes");
  app->require_subcommand(1);
  CLI::App* build = app->add_subcommand("build", "Write a .glb from a YAML of boxes");
  build
      ->add_option("boxes", options->boxes,
                   "YAML of boxes, millimetres (see configs/structure.yaml)")
      ->required();
  build->add_option("-o,--output", options->glb, "structure file to write (.glb)")->required();
  CLI::App* show = app->add_subcommand("show", "Print labels, sides and keypoints");
  show->add_option("structure", options->show, ".glb or .yaml")->required();
#ifdef VOLALIGN_HAS_INFER
  CLI::App* check = app->add_subcommand(
      "check", "Say whether a set of boxes is a good target: symmetries, and what views tell");
  check->add_option("structure", options->check, ".glb or .yaml")->required();
  check
      ->add_option("--distance", options->views.distance_m,
                   "horizontal distance of the sensors from the stack's middle, m")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  check->add_option("--heights", options->views.heights_m, "of the sensors above the floor, m")
      ->check(CLI::PositiveNumber)
      // CLI11's own text of a list is another one where LibTorch's operator<< for vectors is seen.
      ->default_str(fmt::format("[{}]", fmt::join(options->views.heights_m, ",")));
  check->add_option("-o,--output", options->picture, "picture of it, SVG");
#endif
  return {app, [=] {
#ifdef VOLALIGN_HAS_INFER
            if (*check) {
              CheckStructure(options->check, options->views, options->picture);
              return 0;
            }
#endif
            if (*build) {
              WriteStructureGlb(options->glb, ReadStructureYaml(options->boxes));
              SaveCommand(options->glb);
              PrintStructure(ReadStructureGlb(options->glb));
              fmt::print("written: {}\n", options->glb);
            } else {
              PrintStructure(ReadStructure(options->show));
            }
            return 0;
          }};
}

}  // namespace volalign

#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <string>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "cli/table_output.h"
#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/progress_line.h"
#include "core/formats/structure_gltf.h"
#ifdef VOLALIGN_HAS_INFER
#include "infer/plan/target_report.h"
#include "infer/stack/build_sheet.h"
#include "infer/stack/suggest.h"
#endif

namespace volalign {

namespace {

Table SidesTable(const Structure& structure) {
  Table table;
  table.columns = {"label",
                   "side",
                   {"centre_x_m", "centre x, mm", 1000, 1},
                   {"centre_y_m", "y", 1000, 1},
                   {"centre_z_m", "z", 1000, 1},
                   {"exposed_centroid_x_m", "exposed centroid x, mm", 1000, 1},
                   {"exposed_centroid_y_m", "y", 1000, 1},
                   {"exposed_centroid_z_m", "z", 1000, 1},
                   {"exposed", "exposed %", 100, 0}};
  for (int label = 1; label < structure.num_classes(); ++label) {
    const Side& side = structure.SideOfLabel(label);
    const Eigen::Vector3d c = side.Middle(), &e = side.exposed_centroid;
    table.rows.push_back({CellOf(label), side.name, c.x(), c.y(), c.z(), e.x(), e.y(), e.z(),
                          side.exposed_area / side.Area()});
  }
  return table;
}

/// For meshes, the surface that has no label.
std::string WithoutLabel(const Structure& structure) {
  if (structure.IsOfBoxes()) return "";
  double area = 0, all = 0;
  int sides = 0;
  for (const Side& side : structure.sides()) {
    all += side.Area();
    if (side.label > 0) continue;
    area += side.Area();
    ++sides;
  }
  return fmt::format(
      "{} side{} without label, {:.0f} % of the surface: facing down, curved, or smaller than {:g} "
      "cm2 or {:g} cm wide\n",
      sides, sides == 1 ? "" : "s", 100 * area / all, 1e4 * kLeastFacetArea,
      1e2 * kLeastFacetWidth);
}

void PrintStructure(const Structure& structure, const TableOutput& output) {
  WarnOf(structure);
  const Table table = SidesTable(structure);
  output.Print(fmt::format("{}: {}, {} labels and background, {:.0f} mm high, sha256 {}\n{}{}",
                           structure.name(), structure.CountedParts(), structure.num_classes() - 1,
                           structure.Height() * 1e3, structure.Hash().substr(0, 16),
                           WithoutLabel(structure), FormatTable(table, TableFormat::kText)),
               table);
}

void Build(const std::string& file, const MeshUnits& units, const std::string& output,
           const TableOutput& table) {
  const std::string ending = std::filesystem::path(output).extension().string();
  if (ending != ".glb" && ending != ".yaml")
    throw ConfigError(output + ": the file to write ends in .glb or .yaml");
  const Structure structure = ReadStructure(file, units);
  if (ending == ".glb") {
    WriteStructureGlb(output, structure);
  } else {
    WriteFileAtomically(output, StructureYaml(structure));
  }
  SaveCommand(output);
  PrintStructure(structure, table);
  table.Say("written: " + output);
}

#ifdef VOLALIGN_HAS_INFER
void CheckStructure(const std::string& file, const TargetViewOptions& views,
                    const TableOutput& output) {
  const Structure structure = ReadStructure(file);
  ProgressLine line;
  const TargetQuality quality = MeasureTarget(structure, views, line.Counter("views of the stack"));
  line.Stop();
  output.Print(FormatTarget(structure, quality), TargetTable(quality));
}

void WriteSheet(const Structure& structure, const std::string& file, const TableOutput& output) {
  WarnOf(structure);
  WriteFileAtomically(file, BuildSheet(structure));
  SaveCommand(file);
  output.Say("written: " + file);
}

void Suggest(const std::string& boxes, const std::string& file, const SuggestOptions& options,
             const TableOutput& output) {
  const std::filesystem::path sheet = std::filesystem::path(file).replace_extension(".svg");
  if (sheet == file) {
    throw ConfigError(file + ": a structure's file ends in .yaml; its sheet is put beside it");
  }
  ProgressLine line;
  const SuggestedStack suggested = SuggestStack(std::filesystem::path(file).stem().string(),
                                                ParseBoxes(boxes), options, line.Counter("stacks"));
  line.Stop();
  output.Print(FormatTarget(suggested.structure, suggested.quality),
               TargetTable(suggested.quality));
  output.Say(fmt::format("it stands until the floor is tilted by {:.0f} deg", suggested.tilt_deg));
  WriteFileAtomically(file, StructureYaml(suggested.structure));
  SaveCommand(file);
  output.Say("written: " + file);
  WriteSheet(suggested.structure, sheet.string(), output);
}
#endif

}  // namespace

Command AddStructureCommand(CLI::App& program) {
  struct Options {
    std::string boxes, output, show, check, up = ToString(MeshUp::kFormat);
    MeshUnits units;
    TableOutput table;
#ifdef VOLALIGN_HAS_INFER
    std::string build, sheet, owned, suggested;
    SuggestOptions suggest;
    TargetViewOptions views;
#endif
  };
  auto options = std::make_shared<Options>();
  CLI::App* app =
      program.add_subcommand("structure", "Build or show the structure: boxes, or a mesh");
  app->require_subcommand(1);
  constexpr char kFile[] = ".yaml, or a mesh: .glb, .gltf, .obj, .stl, .ply";
  CLI::App* build = app->add_subcommand(
      "build", "Write a .glb to look at, or a .yaml, from a YAML of boxes or from a mesh");
  build
      ->add_option("structure", options->boxes,
                   "YAML of boxes, millimetres (see configs/structure.yaml), or a mesh: .glb, "
                   ".gltf, .obj, .stl, .ply")
      ->required();
  build
      ->add_option("-o,--output", options->output,
                   "picture of the stack to write, glTF (.glb), or the structure itself (.yaml)")
      ->required();
  build
      ->add_option("--mesh-scale", options->units.scale,
                   "metres per unit of a mesh: 0.001 for millimetres")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  build
      ->add_option("--mesh-up", options->up,
                   "the axis of a mesh that points up; format: y in glTF and OBJ, z in STL and PLY")
      ->check(CLI::IsMember(WordsOfAll<MeshUp>()))
      ->capture_default_str();
  options->table.AddOptions(build);
  CLI::App* show = app->add_subcommand("show", "Print labels, sides and keypoints");
  show->add_option("structure", options->show, kFile)->required();
  options->table.AddOptions(show);
#ifdef VOLALIGN_HAS_INFER
  CLI::App* check = app->add_subcommand("check",
                                        "Say whether boxes or a mesh are a good target: its "
                                        "symmetries, and which views determine a pose");
  check->add_option("structure", options->check, kFile)->required();
  check
      ->add_option("--distance", options->views.distance_m,
                   "horizontal distance of the sensors from the stack's middle, m")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  check
      ->add_option("--heights", options->views.heights_m,
                   "height of the sensors above the floor, m")
      ->check(CLI::PositiveNumber)
      // CLI11's own text of a list changes where LibTorch's operator<< for vectors is visible.
      ->default_str(fmt::format("[{}]", fmt::join(options->views.heights_m, ",")));
  options->table.AddOptions(check);
  CLI::App* sheet = app->add_subcommand(
      "sheet", "Draw how to build it: one A4 page to print, with every length in mm");
  sheet->add_option("structure", options->build, ".yaml of boxes")->required();
  sheet->add_option("-o,--output", options->sheet, "picture to write, SVG")->required();
  CLI::App* suggest = app->add_subcommand(
      "suggest", "Find a stack of your boxes that is a good target: its YAML and its sheet");
  suggest
      ->add_option("boxes", options->owned,
                   "numbers and edges in mm, e.g. \"3x 600x400x400, 2x 400x300x250\"")
      ->required();
  suggest
      ->add_option("-o,--output", options->suggested,
                   "file to write, YAML; its sheet is put beside it (.svg)")
      ->required();
  suggest->add_option("--height", options->suggest.height_m, "largest height of the stack, m")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  suggest
      ->add_option("--candidates", options->suggest.candidates,
                   "number of stacks that are drawn at random and compared")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  suggest->add_option("--threads", options->suggest.threads, "threads over the stacks")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  options->table.AddOptions(suggest);
#endif
  return {app, [=] {
#ifdef VOLALIGN_HAS_INFER
            if (*check) {
              CheckStructure(options->check, options->views, options->table);
              return 0;
            }
            if (*sheet) {
              WriteSheet(ReadStructure(options->build), options->sheet, options->table);
              return 0;
            }
            if (*suggest) {
              Suggest(options->owned, options->suggested, options->suggest, options->table);
              return 0;
            }
#endif
            if (*build) {
              FromWord(options->up, &options->units.up);
              Build(options->boxes, options->units, options->output, options->table);
            } else {
              PrintStructure(ReadStructure(options->show), options->table);
            }
            return 0;
          }};
}

}  // namespace volalign

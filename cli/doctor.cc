// The program's environment, and whether everything that it needs is there.

#include <ATen/Context.h>
#include <ATen/Parallel.h>
#include <fmt/format.h>
#include <torch/version.h>
#include <unistd.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "cli/commands.h"
#include "cli/table_output.h"
#include "core/base/error.h"
#include "core/base/input_file.h"
#include "core/base/processor.h"
#include "core/base/progress_line.h"
#include "core/base/provenance.h"
#include "core/geometry/structure.h"
#include "core/nn/checkpoint.h"
#include "render/egl/renderers.h"
#ifdef VOLALIGN_HAS_INFER
#include "infer/refine/refine.h"
#endif

namespace volalign {

namespace {

std::string Libraries() {
#ifdef VOLALIGN_HAS_INFER
  return "LibTorch " TORCH_VERSION ", Ceres " + CeresVersion();
#else
  return "LibTorch " TORCH_VERSION "; built without calibration (VOLALIGN_INFER=OFF)";
#endif
}

/// Its cores, and the instruction sets for which there are kernels. Throws Error if it has not
/// those of the program.
std::string ProcessorText() {
#ifdef __SSE4_2__
  if (!__builtin_cpu_supports("sse4.2"))
    throw Error("a processor with SSE 4.2, for which this program was built");
#endif
  const Processor& processor = ThisProcessor();
  std::string sets;
  for (const auto& [has, set] : {std::pair(processor.avx2, "AVX2"), {processor.avx512, "AVX-512"}})
    if (has) sets += std::string(", ") + set;
  return fmt::format("{} cores, {} threads for LibTorch{}", ::sysconf(_SC_NPROCESSORS_ONLN),
                     at::get_num_threads(), sets);
}

std::string GpuText() {
  if (!at::hasCUDA())
    return "none that LibTorch can use; training and networks run on the processor";
  return fmt::format("LibTorch sees CUDA, {} devices", at::detail::getCUDAHooks().getNumGPUs());
}

std::string DataText() {
  if (!DataFolder().empty()) return DataFolder();
  throw Error(
      "no folder with configs and models was found; --data-dir or VOLALIGN_DATA_DIR names it");
}

std::string StructureText() {
  const Structure structure = ReadStructure(FindInputFile("configs/structure.yaml"));
  return fmt::format("{}, {}", structure.name(), structure.CountedParts());
}

std::string ModelText(const std::string& path) {
  const LoadedModel model = LoadCheckpoint(path);
  return fmt::format("{}: {} classes, {} training samples", FindInputFile(path),
                     model.meta.structure.num_classes(), model.meta.samples);
}

/// What there is of each part. The functions throw Error if it is missing.
int RunDoctor(const std::string& model, const TableOutput& output) {
  const std::pair<std::string, std::function<std::string()>> parts[] = {
      {"volalign", Tool},
      {"libraries", Libraries},
      {"compiler", [] { return fmt::format("{}, C++{}", __VERSION__, __cplusplus / 100 % 100); }},
      {"processor", ProcessorText},
      {"renderer", [] { return ChooseRenderers(RendererKind::kEgl).description; }},
      {"GPU", GpuText},
      {"data folder", DataText},
      {"structure", StructureText},
      {"model", [&] { return ModelText(model); }}};
  Table table{{"part", "found", {"missing", ""}}, {}};
  bool complete = true;
  ProgressLine line;
  line.Begin("looking at libraries, renderer, data and model");
  for (const auto& [part, find] : parts) {
    try {
      table.rows.push_back({part, find(), false});
    } catch (const Error& error) {
      table.rows.push_back({part, fmt::format("MISSING: {}", error.what()), true});
      complete = false;
    }
  }
  line.Stop();
  output.Print(FormatTable(table, TableFormat::kText), table);
  output.Say(complete ? "everything is there" : "something is missing, see above");
  return complete ? 0 : 2;
}

}  // namespace

Command AddDoctorCommand(CLI::App& program) {
  auto model = std::make_shared<std::string>(kShippedModel);
  auto output = std::make_shared<TableOutput>();
  CLI::App* app = program.add_subcommand("doctor",
                                         "Say what the program runs on: libraries, processor, "
                                         "renderer, GPU, data and model; exits with "
                                         "status 2 where something is missing");
  app->add_option("--model", *model, "checkpoint to load")->capture_default_str();
  output->AddOptions(app);
  return {app, [model, output] { return RunDoctor(*model, *output); }};
}

}  // namespace volalign

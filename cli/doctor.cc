// The program's environment, and whether everything that it needs is there.

#include <ATen/Context.h>
#include <ATen/Parallel.h>
#include <fmt/format.h>
#include <torch/version.h>
#include <unistd.h>

#include <Eigen/Core>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>

#include "cli/commands.h"
#include "cli/table_output.h"
#include "core/base/error.h"
#include "core/base/input_file.h"
#include "core/base/progress_line.h"
#include "core/base/provenance.h"
#include "core/geometry/structure.h"
#include "core/nn/checkpoint.h"
#include "render/egl/renderers.h"
#ifdef VOLALIGN_HAS_INFER
#include "infer/refine/ceres_version.h"
#endif

namespace volalign {

namespace {

/// The findings, and how much of them is in the way.
class Findings {
 public:
  void Say(const std::string& what, const std::string& text) {
    table_.rows.push_back({what, text, false});
  }
  void Miss(const std::string& what, const std::string& text) {
    table_.rows.push_back({what, "MISSING: " + text, true});
    ++missing_;
  }
  int missing() const { return missing_; }
  const Table& table() const { return table_; }

 private:
  Table table_{{"part", "found", {"missing", ""}}, {}};
  int missing_ = 0;
};

std::string Libraries() {
  std::string text = fmt::format(
      "LibTorch {}, Eigen {}.{}.{}, fmt {}.{}.{}, JSON {}.{}.{}, CLI11 {}", TORCH_VERSION,
      EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION, FMT_VERSION / 10000,
      FMT_VERSION / 100 % 100, FMT_VERSION % 100, NLOHMANN_JSON_VERSION_MAJOR,
      NLOHMANN_JSON_VERSION_MINOR, NLOHMANN_JSON_VERSION_PATCH, CLI11_VERSION);
#ifdef VOLALIGN_HAS_INFER
  text += ", Ceres " + CeresVersion();
#else
  text += "; built without calibration (VOLALIGN_INFER=OFF)";
#endif
  return text;
}

void CheckLibraries(Findings* findings) {
  findings->Say("libraries", Libraries());
  findings->Say("compiler", fmt::format("{}, C++{}", __VERSION__, __cplusplus / 100 % 100));
}

/// The value of a line "key : value" of /proc/cpuinfo.
std::string CpuInfo(const std::string& key) {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.rfind(key, 0) == 0 && line.find(':') != std::string::npos)
      return line.substr(line.find(':') + 2);
  }
  return "";
}

void CheckProcessor(Findings* findings) {
  std::istringstream words(CpuInfo("flags"));
  std::set<std::string> flags;
  for (std::string word; words >> word;) flags.insert(word);
  std::string found;
  for (const char* flag : {"sse4_2", "avx", "avx2", "fma", "avx512f"}) {
    if (flags.count(flag)) found += std::string(found.empty() ? "" : " ") + flag;
  }
  const std::string name = CpuInfo("model name");
  findings->Say("processor",
                fmt::format("{}, {} cores, {} threads for LibTorch, {}",
                            name.empty() ? "unknown" : name, ::sysconf(_SC_NPROCESSORS_ONLN),
                            at::get_num_threads(), found.empty() ? "no known extensions" : found));
#ifdef __SSE4_2__
  if (!flags.empty() && !flags.count("sse4_2"))
    findings->Miss("processor", "SSE 4.2, for which this program was built");
#endif
}

void CheckRenderer(Findings* findings) {
  try {
    findings->Say("renderer", ChooseRenderers("egl").description);
  } catch (const Error& error) {
    findings->Miss("renderer", error.what());
  }
}

void CheckGpu(Findings* findings) {
  if (!at::hasCUDA()) {
    findings->Say("GPU", "none that LibTorch can use; training and networks run on the processor");
    return;
  }
  findings->Say("GPU", fmt::format("LibTorch sees CUDA, {} devices",
                                   at::detail::getCUDAHooks().getNumGPUs()));
}

void CheckData(const std::string& model_path, Findings* findings) {
  if (DataFolder().empty()) {
    findings->Miss("data folder",
                   "no folder with configs and models was found; --data-dir or VOLALIGN_DATA_DIR "
                   "names it");
  } else {
    findings->Say("data folder", DataFolder());
  }
  try {
    const Structure structure = ReadStructure(FindInputFile("configs/structure.yaml"));
    findings->Say("structure", fmt::format("{}, {}", structure.name(), structure.CountedParts()));
  } catch (const Error& error) {
    findings->Miss("structure", error.what());
  }
  try {
    const LoadedModel model = LoadCheckpoint(model_path);
    findings->Say("model",
                  fmt::format("{}: {} classes, {} training samples", FindInputFile(model_path),
                              model.meta.structure.num_classes(), model.meta.samples));
  } catch (const Error& error) {
    findings->Miss("model", error.what());
  }
}

}  // namespace

std::string VersionText() {
  std::string renderer;
  try {
    renderer = ChooseRenderers("auto").description;
  } catch (const Error& error) {
    renderer = error.what();
  }
  return fmt::format("{}\nlibraries: {}\nrenderer: {}", Tool(), Libraries(), renderer);
}

Command AddDoctorCommand(CLI::App& program) {
  auto model = std::make_shared<std::string>(kShippedModel);
  auto output = std::make_shared<TableOutput>();
  CLI::App* app = program.add_subcommand("doctor",
                                         "Say what the program runs on: libraries, processor, "
                                         "renderer, GPU, data and model; exits with "
                                         "status 2 where something is missing");
  app->add_option("--model", *model, "checkpoint to load")->capture_default_str();
  output->AddOptions(app);
  return {app, [model, output] {
            Findings findings;
            ProgressLine line;
            line.Begin("looking at libraries, renderer, data and model");
            findings.Say("volalign", Tool());
            CheckLibraries(&findings);
            CheckProcessor(&findings);
            CheckRenderer(&findings);
            CheckGpu(&findings);
            CheckData(*model, &findings);
            line.Stop();
            output->Print(FormatTable(findings.table(), TableFormat::kText), findings.table());
            output->Say(findings.missing() == 0 ? "everything is there"
                                                : "something is missing, see above");
            return findings.missing() == 0 ? 0 : 2;
          }};
}

}  // namespace volalign

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "core/base/error.h"
#include "core/base/progress_line.h"
#include "core/nn/export_onnx.h"
#include "core/nn/export_torchscript.h"

namespace volalign {

namespace {

struct Format {
  const char* word;
  const char* ending;
  void (*write)(const std::filesystem::path& checkpoint, const std::filesystem::path& output,
                bool half);
};

const Format kFormats[] = {{"torchscript", ".ts", ExportTorchScript},
                           {"onnx", ".onnx", ExportOnnx}};

/// The format of `word`. Throws ConfigError if the output's ending is not the format's.
const Format& FormatOf(const std::string& word, const std::string& output) {
  const Format& format = *std::find_if(std::begin(kFormats), std::end(kFormats),
                                       [&](const Format& f) { return word == f.word; });
  if (std::filesystem::path(output).extension() != format.ending) {
    throw ConfigError(
        fmt::format("{}: a file of --format {} ends with {}", output, word, format.ending));
  }
  return format;
}

}  // namespace

Command AddExportCommand(CLI::App& program) {
  struct Options {
    std::string model, output, format = "torchscript", precision = "fp32";
  };
  auto options = std::make_shared<Options>();
  CLI::App* app = program.add_subcommand(
      "export", "Write a checkpoint for other programs: docs/deployment.md says which runs what");
  app->add_option("--model", options->model, "checkpoint, e.g. models/m05-lite.safetensors")
      ->required();
  app->add_option("--format", options->format, "both have the network with its input encoding")
      ->check(CLI::IsMember({"torchscript", "onnx"}))
      ->capture_default_str();
  app->add_option("--precision", options->precision,
                  "of the stored weights; everything is computed in fp32")
      ->check(CLI::IsMember({"fp32", "fp16"}))
      ->capture_default_str();
  app->add_option("-o,--output", options->output, "file to write: .ts or .onnx, as the format says")
      ->required();
  return {app, [options] {
            const Format& format = FormatOf(options->format, options->output);
            ProgressLine line;
            line.Begin("writing " + options->output);
            format.write(options->model, options->output, options->precision == "fp16");
            line.Stop();
            SaveCommand(options->output);
            fmt::print(
                "written: {} (depth [B,1,H,W] float32, metres -> log-probabilities [B,K,H,W])\n",
                options->output);
            return 0;
          }};
}

}  // namespace volalign

#include <fmt/format.h>

#include <memory>
#include <string>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "core/nn/export_torchscript.h"

namespace volalign {

Command AddExportCommand(CLI::App& program) {
  struct Options {
    std::string model, output;
  };
  auto options = std::make_shared<Options>();
  CLI::App* app =
      program.add_subcommand("export", "Write a checkpoint as self-contained TorchScript");
  app->add_option("--model", options->model, "checkpoint, e.g. models/m05-lite.pt")->required();
  app->add_option("-o,--output", options->output, "TorchScript file to write (.ts)")->required();
  return {app, [options] {
            ExportTorchScript(options->model, options->output);
            SaveCommand(options->output);
            fmt::print(
                "written: {} (depth [B,1,H,W] float32, metres -> log-probabilities [B,K,H,W])\n",
                options->output);
            return 0;
          }};
}

}  // namespace volalign

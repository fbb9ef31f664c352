#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace volalign {

/// The network of configs/structure.yaml that comes with the program, in the data folder.
inline constexpr char kShippedModel[] = "models/m05-lite.safetensors";

/// A sub-command: the app that the parser fills in, and the function that runs. `run` returns the
/// exit status and throws volalign::Error for everything that `main` should print.
struct Command {
  CLI::App* app = nullptr;
  std::function<int()> run;
};

Command AddStructureCommand(CLI::App& program);
Command AddRenderCommand(CLI::App& program);
Command AddTrainCommand(CLI::App& program);
Command AddRunsCommand(CLI::App& program);
Command AddValidateCommand(CLI::App& program);
Command AddExportCommand(CLI::App& program);
Command AddConfigCommand(CLI::App& program);
Command AddDoctorCommand(CLI::App& program);
#ifdef VOLALIGN_HAS_INFER
Command AddCalibrateCommand(CLI::App& program);
Command AddCheckCommand(CLI::App& program);
Command AddAddCommand(CLI::App& program);
Command AddInitCommand(CLI::App& program);
Command AddEvaluateCommand(CLI::App& program);
Command AddConvertCommand(CLI::App& program);
Command AddPlanCommand(CLI::App& program);
#endif

}  // namespace volalign

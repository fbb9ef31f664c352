#include <fmt/format.h>

#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "cli/commands.h"
#include "core/error.h"
#include "render/egl_context.h"

int main(int argc, char** argv) {
  volalign::KeepSoftwareRenderingOnOneThread();
  CLI::App program("volalign aligns depth sensors from one still frame each of a stack of boxes",
                   "volalign");
  program.set_version_flag("--version", "volalign " VOLALIGN_VERSION);
  program.require_subcommand(1);
  const std::vector<volalign::Command> commands = {
      volalign::AddStructureCommand(program), volalign::AddRenderCommand(program),
      volalign::AddTrainCommand(program),     volalign::AddRunsCommand(program),
      volalign::AddValidateCommand(program),
#ifdef VOLALIGN_HAS_INFER
      volalign::AddCalibrateCommand(program), volalign::AddEvaluateCommand(program),
      volalign::AddConvertCommand(program),
#endif
      volalign::AddExportCommand(program),    volalign::AddConfigCommand(program)};
  try {
    program.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return program.exit(e) == 0 ? 0 : 1;
  }
  try {
    for (const volalign::Command& command : commands) {
      if (*command.app) return command.run();
    }
  } catch (const volalign::Error& e) {
    fmt::print(stderr, "error: {}\n", e.what());
  } catch (const std::exception& e) {
    const std::string text = e.what();
    fmt::print(stderr, "error: {}\n", text.substr(0, text.find('\n')));
  }
  return 1;
}

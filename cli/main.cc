#include "cli/main.h"

#include <fmt/format.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <string>
#include <vector>

#include "cli/app_tree.h"
#include "cli/command_line.h"
#include "cli/commands.h"
#include "core/base/error.h"
#include "core/base/input_file.h"
#include "core/base/interrupt.h"
#include "core/base/provenance.h"
#include "core/base/text.h"
#include "render/egl/egl_context.h"
#include "train/compute.h"

namespace volalign {

namespace {

/// The commands, with the headings under which the program's help lists them.
std::vector<Command> AddCommands(CLI::App& program) {
  std::vector<Command> commands;
  const auto add = [&](const char* heading, const std::vector<Command>& group) {
    for (const Command& command : group) {
      command.app->group(heading);
      commands.push_back(command);
    }
  };
  add("Calibrate a rig",
      {AddStructureCommand(program),
#ifdef VOLALIGN_HAS_INFER
       AddPlanCommand(program), AddInitCommand(program), AddCalibrateCommand(program),
       AddConvertCommand(program), AddCheckCommand(program), AddAddCommand(program)
#endif
      });
  add("Render and train",
      {AddRenderCommand(program), AddTrainCommand(program), AddRunsCommand(program),
       AddValidateCommand(program), AddExportCommand(program)});
#ifdef VOLALIGN_HAS_INFER
  add("Measure", {AddEvaluateCommand(program)});
#endif
  add("Tools", {AddConfigCommand(program), AddDoctorCommand(program)});
  return commands;
}

/// Reads the arguments. True if they were understood; else `status` is that of the program.
bool Parse(CLI::App* program, int argc, char** argv, int* status) {
  try {
    program->parse(argc, argv);
    return true;
  } catch (const CLI::ParseError& error) {
    const std::string misspelled = Misspelled(program);
    const bool knows_command = misspelled.empty() || !program->get_subcommands().empty();
    if (error.get_exit_code() == 0 && knows_command) {  // --help, --version
      *status = program->exit(error);
      return false;
    }
    // Misspelled options are missing, too.
    fmt::print(stderr, "error: {}\n",
               misspelled.empty() ? MessageLine(error.what()) + " (--help says more)"
                                  : MessageLine(misspelled));
    *status = 1;
  }
  return false;
}

/// `status`, or 1 with an error if standard output did not take everything. If `status` is 1, an
/// error was printed before.
int Written(int status) {
  if (status == 1) return status;
  errno = 0;
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return status;
  const std::string why = errno == 0 ? "" : fmt::format(": {}", std::strerror(errno));
  fmt::print(stderr, "error: cannot write all of standard output{}\n", why);
  return 1;
}

int Run(int argc, char** argv) {
  CLI::App program(
      "volalign finds the poses of depth sensors from one depth frame each of a stack of boxes",
      "volalign");
  program.set_version_flag("--version", Tool);
  program.require_subcommand(1);
  program.formatter(HelpFormatter());
  program.footer("Pages: " + WithPages("docs/index.md"));
  const std::vector<Command> commands = AddCommands(program);
  std::string data_dir;
  ForEachApp(&program, [&](CLI::App* app, const std::string&) {
    app->add_option("--data-dir", data_dir,
                    "folder that has configs and models, where inputs that are not in the working "
                    "directory are looked for");
  });
  AddExamples(&program);
  int status = 1;
  try {
    for (int i = 1; i < argc; ++i) RequireUtf8(argv[i], fmt::format("argument {},", i));
    if (!Parse(&program, argc, argv, &status)) return status;
    SetDataFolder(FindDataFolder(data_dir));
    KeepCommand(&program, argc, argv);
    for (const Command& command : commands) {
      if (*command.app) return command.run();
    }
  } catch (const IoError& e) {
    fmt::print(stderr, "error: {}{}\n", WithPages(e.what()), DataFolderHint(e.what()));
  } catch (const Error& e) {
    fmt::print(stderr, "error: {}\n", WithPages(e.what()));
  } catch (const std::exception& e) {
    fmt::print(stderr, "error: {}\n", SentenceOf(e));
  }
  return 1;
}

}  // namespace

int Main(int argc, char** argv) {
  KeepSoftwareRenderingOnOneThread();
  EndOnInterrupt();
  KeepFreedMemory();
  std::signal(SIGXFSZ, SIG_IGN);  // a write beyond the limit fails with an error
  return Written(Run(argc, argv));
}

}  // namespace volalign

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <string>
#include <vector>

#include "cli/app_tree.h"
#include "cli/commands.h"

namespace volalign {

std::string BashCompletion(CLI::App* program) {
  std::string paths, words, values;
  ForEachApp(program, [&](CLI::App* app, const std::string& path) {
    if (!path.empty()) paths += fmt::format("      \"{}\") command=\"$next\" ;;\n", path);
    std::vector<std::string> all = CommandNames(app);
    for (const std::string& option : OptionNames(app)) all.push_back(option);
    words += fmt::format("    \"{}\") choices=\"{}\" ;;\n", path, fmt::join(all, " "));
    for (const CLI::Option* option : app->get_options([](const CLI::Option*) { return true; })) {
      const std::vector<std::string> choices = Choices(option);
      if (choices.empty()) continue;
      for (const std::string& name : option->get_lnames())
        values += fmt::format("    \"{} --{}\") choices=\"{}\" ;;\n", path, name,
                              fmt::join(choices, " "));
    }
  });
  return "# Completion of volalign, as `volalign completion` prints it.\n"
         "_volalign() {\n"
         "  local cur=\"${COMP_WORDS[COMP_CWORD]}\" previous=\"${COMP_WORDS[COMP_CWORD-1]}\"\n"
         "  local command=\"\" next choices=\"\" i\n"
         "  for ((i = 1; i < COMP_CWORD; ++i)); do\n"
         "    next=\"${command:+$command }${COMP_WORDS[i]}\"\n"
         "    case \"$next\" in\n" +
         paths +
         "    esac\n"
         "  done\n"
         "  case \"$command\" in\n" +
         words +
         "  esac\n"
         "  case \"$command $previous\" in\n" +
         values +
         "  esac\n"
         "  COMPREPLY=($(compgen -W \"$choices\" -- \"$cur\"))\n"
         "}\n"
         "complete -o default -F _volalign volalign\n";
}

Command AddCompletionCommand(CLI::App& program) {
  CLI::App* app = program.add_subcommand("completion", "Print a completion for the shell");
  app->require_subcommand(1);
  app->add_subcommand("bash", "A script for bash: sub-commands, options and their choices");
  return {app, [&program] {
            fmt::print("{}", BashCompletion(&program));
            return 0;
          }};
}

}  // namespace volalign

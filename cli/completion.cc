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

std::string ZshCompletion(CLI::App* program) {
  return "typeset -f compdef > /dev/null || { autoload -U compinit && compinit; }\n"
         "autoload -U bashcompinit && bashcompinit\n" +
         BashCompletion(program);
}

std::string FishCompletion(CLI::App* program) {
  std::string paths, rules;
  ForEachApp(program, [&](CLI::App* app, const std::string& path) {
    if (!path.empty()) paths += fmt::format(" '{}'", path);
    const std::string rule = fmt::format("complete -c volalign -n '__volalign_is \"{}\"'", path);
    if (const std::vector<std::string> commands = CommandNames(app); !commands.empty())
      rules += fmt::format("{} -f -a '{}'\n", rule, fmt::join(commands, " "));
    for (const CLI::Option* option : app->get_options([](const CLI::Option*) { return true; })) {
      const std::vector<std::string> choices = Choices(option);
      std::string takes = option->get_items_expected_max() > 0 ? " -r" : "";
      if (!choices.empty()) takes = fmt::format(" -x -a '{}'", fmt::join(choices, " "));
      for (const std::string& name : option->get_lnames())
        rules += fmt::format("{} -l {}{}\n", rule, name, takes);
    }
  });
  return "# Completion of volalign, as `volalign completion` prints it.\n"
         "function __volalign_is\n"
         "  set -l command ''\n"
         "  for word in (commandline -opc)[2..-1]\n"
         "    set -l next (string trim \"$command $word\")\n"
         "    contains -- $next" +
         paths +
         "; and set command $next\n"
         "  end\n"
         "  test \"$command\" = \"$argv[1]\"\n"
         "end\n" +
         rules;
}

Command AddCompletionCommand(CLI::App& program) {
  CLI::App* app =
      program.add_subcommand("completion", "Print a shell's completion of this program");
  app->require_subcommand(1);
  for (const char* shell : {"bash", "zsh", "fish"}) {
    app->add_subcommand(
        shell, fmt::format("A script for {}: sub-commands, options and their choices", shell));
  }
  return {app, [app, &program] {
            const std::string shell = app->get_subcommands().front()->get_name();
            fmt::print("{}", shell == "fish"  ? FishCompletion(&program)
                             : shell == "zsh" ? ZshCompletion(&program)
                                              : BashCompletion(&program));
            return 0;
          }};
}

}  // namespace volalign

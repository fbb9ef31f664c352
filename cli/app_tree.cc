#include "cli/app_tree.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "core/base/text.h"
#include "core/config/config.h"

namespace volalign {

namespace {

const auto kAllApps = [](const CLI::App* app) { return !app->get_name().empty(); };
const auto kAllOptions = [](const CLI::Option*) { return true; };

/// The names of the sub-commands below an app.
std::vector<std::string> CommandNames(const CLI::App* app) {
  std::vector<std::string> names;
  for (const CLI::App* sub : app->get_subcommands(kAllApps)) names.push_back(sub->get_name());
  return names;
}

/// The long names of its options, with their dashes.
std::vector<std::string> OptionNames(const CLI::App* app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app->get_options(kAllOptions)) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

/// The words that an option may have as its value; empty if it may have any.
/// CLI11 keeps the words of IsMember in the name of the option's type alone: "TEXT:{auto,none}".
std::vector<std::string> Choices(const CLI::Option* option) {
  const std::string type = option->get_type_name();
  const std::size_t begin = type.find('{'), end = type.find('}');
  if (begin == std::string::npos || end == std::string::npos) return {};
  return Split(type.substr(begin + 1, end - begin - 1), ',');
}

/// The limits of an option's value, in words: "1 to 100", "above 0"; "" without any.
/// CLI11 keeps the limits of Range and of its checks of signs in that name alone, too: "INT in [1 -
/// 100]", "FLOAT:POSITIVE".
std::string Limits(const CLI::Option* option) {
  const std::string type = option->get_type_name();
  const std::size_t begin = type.find('['), middle = type.find(" - "), end = type.find(']');
  if (begin < middle && middle < end && end != std::string::npos) {
    return fmt::format("{} to {}", type.substr(begin + 1, middle - begin - 1),
                       type.substr(middle + 3, end - middle - 3));
  }
  if (type.find("NONNEGATIVE") != std::string::npos) return "0 or above";
  return type.find("POSITIVE") != std::string::npos ? "above 0" : "";
}

std::string Suggestion(const std::string& word, const std::vector<std::string>& known) {
  const std::string nearest = NearestKey(word, known);
  return nearest.empty() ? "" : fmt::format("; did you mean {}?", nearest);
}

/// Suggests the first missing option for an argument that stands by itself.
std::string Place(const CLI::App* app, const std::string& argument) {
  for (const CLI::Option* option : app->get_options(kAllOptions)) {
    if (!option->get_required() || option->count() > 0 || option->get_lnames().empty()) continue;
    const std::string& name = option->get_lnames().front();
    std::error_code error;
    const bool folder = name == "capture" && std::filesystem::is_directory(argument, error);
    return fmt::format(" by itself: did you mean --{} {}{}?{}", name, argument,
                       folder ? "/capture.json" : "",
                       folder ? fmt::format(" `volalign init {}` writes that file", argument) : "");
  }
  return "";
}

}  // namespace

void ForEachApp(CLI::App* app, const std::function<void(CLI::App*, const std::string& path)>& use,
                const std::string& path) {
  use(app, path);
  for (CLI::App* sub : app->get_subcommands([](CLI::App*) { return true; }))
    ForEachApp(sub, use, path.empty() ? sub->get_name() : path + " " + sub->get_name());
}

std::shared_ptr<CLI::FormatterBase> HelpFormatter() {
  class Formatter : public CLI::Formatter {
    std::string make_option_opts(const CLI::Option* option) const override {
      if (option->get_type_size() == 0) return "";
      const std::vector<std::string> words = Choices(option);
      const std::string type = option->get_type_name();
      std::string text = " " + (words.empty() ? type.substr(0, type.find(':'))
                                              : fmt::format("{{{}}}", fmt::join(words, ",")));
      if (option->get_expected_max() > 1) text += " ...";
      std::vector<std::string> notes;
      if (option->get_required()) notes.emplace_back("required");
      if (const std::string limits = Limits(option); !limits.empty()) notes.push_back(limits);
      if (!option->get_default_str().empty())
        notes.push_back("default " + option->get_default_str());
      return notes.empty() ? text : fmt::format("{} ({})", text, fmt::join(notes, "; "));
    }
  };
  return std::make_shared<Formatter>();
}

std::string Misspelled(CLI::App* program) {
  CLI::App* app = program;
  std::string path = "volalign";
  while (!app->get_subcommands().empty()) {
    app = app->get_subcommands().front();
    path += " " + app->get_name();
  }
  const std::vector<std::string> rest = program->remaining(/*recurse=*/true);
  if (rest.empty()) return "";
  const std::string name = rest.front().substr(0, rest.front().find('='));
  const bool option = name.rfind('-', 0) == 0;
  const std::vector<std::string> names = option ? OptionNames(app) : CommandNames(app);
  if (names.empty()) {
    return fmt::format("{} takes no argument \"{}\"{}; {} --help lists what it takes", path,
                       rest.front(), Place(app, rest.front()), path);
  }
  return fmt::format("{} has no {} {}{} ({} --help lists them)", path,
                     option ? "option" : "sub-command", name, Suggestion(name, names), path);
}

}  // namespace volalign

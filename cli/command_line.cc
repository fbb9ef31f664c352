#include "cli/command_line.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>
#include <system_error>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/base/provenance.h"
#include "core/base/text.h"
#include "core/geometry/stack_faults.h"

namespace volalign {

namespace {

struct Kept {
  std::string line;
  const CLI::App* program = nullptr;
};

Kept& SavedCommandLine() {
  static Kept kept;
  return kept;
}

/// A text in double quotes, as YAML has it.
std::string Text(const std::string& text) { return nlohmann::json(text).dump(); }

/// The sub-command that was called.
const CLI::App* Called(const CLI::App* app) {
  while (!app->get_subcommands().empty()) app = app->get_subcommands().front();
  return app;
}

/// "  name: value", from the arguments or the default; "" for an option with neither.
std::string OptionLine(const CLI::Option* option) {
  const std::string name =
      option->get_lnames().empty() ? option->get_name() : option->get_lnames().front();
  std::vector<std::string> values;
  for (const std::string& value : option->results()) values.push_back(Text(value));
  if (values.empty() && !option->get_default_str().empty())
    values.push_back(Text(option->get_default_str()));
  if (values.empty()) return "";
  if (option->get_expected_max() > 1 && option->count() > 0)
    return fmt::format("  {}: [{}]\n", name, fmt::join(values, ", "));
  return fmt::format("  {}: {}\n", name, values.back());
}

std::filesystem::path CommandFile(const std::filesystem::path& result) {
  if (std::filesystem::is_directory(result)) return result / "command.yaml";
  std::filesystem::path file = result;
  file += ".command.yaml";
  return file;
}

std::string HashLine(const std::filesystem::path& file) {
  return fmt::format("sha256: {}\n", Sha256(ReadFile(file, kMaxResultBytes)));
}

std::string CommandText(const std::vector<std::pair<std::string, std::string>>& configs) {
  std::string text = fmt::format("version: {}\ncommand: {}\noptions:\n", Text(Tool()),
                                 Text(SavedCommandLine().line));
  const CLI::App* app = Called(SavedCommandLine().program);
  for (const CLI::Option* option : app->get_options([](const CLI::Option*) { return true; }))
    text += OptionLine(option);
  for (const auto& [name, yaml] : configs) text += Text(name) + ":\n" + Indented(yaml, "  ");
  return text;
}

}  // namespace

std::string ShellWord(const std::string& word) {
  constexpr const char* kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_@%+=:,./-";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) return word;
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? "'\\''" : std::string(1, c);
  return quoted + "'";
}

void KeepCommand(const CLI::App* program, int argc, const char* const* argv) {
  std::string line;
  for (int i = 0; i < argc; ++i) line += (i > 0 ? " " : "") + ShellWord(argv[i]);
  SavedCommandLine() = {line, program};
}

std::string CommandLine() { return SavedCommandLine().line; }

void SaveStart(const std::filesystem::path& folder) {
  std::filesystem::path file = folder / "command.yaml";
  for (int start = 2; std::filesystem::exists(file); ++start)
    file = folder / fmt::format("command-{}.yaml", start);
  WriteFileAtomically(file, CommandText({}));
}

void SaveCommand(const std::filesystem::path& result,
                 const std::vector<std::pair<std::string, std::string>>& configs) {
  std::string text = CommandText(configs);
  if (!std::filesystem::is_directory(result)) text += HashLine(result);
  WriteFileAtomically(CommandFile(result), text);
}

void WarnOf(const Structure& structure) {
  for (const StackFault& fault : FindStackFaults(structure))
    fmt::print(stderr, "warning: {}: {}\n", structure.name(), fault.text);
}

bool IsAsWritten(const std::filesystem::path& file) {
  std::error_code error;
  const std::filesystem::path command = CommandFile(file);
  return std::filesystem::exists(command, error) &&
         ReadFile(command, kMaxTextBytes).find("\n" + HashLine(file)) != std::string::npos;
}

std::string FindDataFolder(const std::string& given) {
  if (!given.empty()) {
    if (!IsDataFolder(given)) {
      throw IoError(fmt::format(
          "--data-dir {}: configs/structure.yaml is not in it; give the folder that has configs "
          "and models",
          given));
    }
    return given;
  }
  return DataFolder();
}

std::string WithPages(std::string message) {
  const std::filesystem::path data = DataFolder();
  const std::string docs = "docs/", ending = ".md";
  for (std::size_t at = 0; (at = message.find(docs, at)) != std::string::npos; at += docs.size()) {
    const std::size_t end = message.find(ending, at);
    if (end == std::string::npos) break;
    if (at > 0 && message[at - 1] == '/') continue;  // a user's folder
    const std::string page = message.substr(at, end + ending.size() - at);
    for (const std::filesystem::path& folder :
         {std::filesystem::path(), data, data / "../doc/volalign"}) {
      std::error_code error;
      if (!std::filesystem::exists(folder / page, error)) continue;
      const std::string found = (folder / page).lexically_normal().string();
      message.replace(at, page.size(), found);
      at += found.size() - page.size();
      break;
    }
  }
  return message;
}

std::string DataFolderHint(const std::string& message) {
  const bool of_data =
      message.find("configs/") != std::string::npos || message.find("models/") != std::string::npos;
  if (!DataFolder().empty() || !of_data) return "";
  return "; the program's own configs and models were not found: --data-dir FOLDER, or "
         "VOLALIGN_DATA_DIR in the environment, names the folder that has them";
}

}  // namespace volalign

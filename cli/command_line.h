#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/structure.h"

namespace volalign {

/// A word of a command, in quotes if a shell needs them.
std::string ShellWord(const std::string& word);

/// The program's call, as a shell reads it.
std::string CommandLine();

/// Keeps the program's arguments for CommandLine, and the parser's values for SaveCommand. Main
/// calls it once, before a sub-command runs.
void KeepCommand(const CLI::App* program, int argc, const char* const* argv);

/// Writes the origin of a result: RESULT/command.yaml for a folder, else RESULT.command.yaml beside
/// it. It has the program's version, the command line, and every option of the sub-command as it
/// was used. It also has `configs`, names and YAML of resolved configurations without a file of
/// their own, and the SHA-256 of a result that is a file. Throws IoError.
void SaveCommand(const std::filesystem::path& result,
                 const std::vector<std::pair<std::string, std::string>>& configs = {});

/// Warns on standard error of faults in the description of a stack.
void WarnOf(const Structure& structure);

/// Is the file unchanged since SaveCommand? Throws IoError.
bool IsAsWritten(const std::filesystem::path& file);

/// Writes the origin of work that may be started again in its folder: command.yaml, then
/// command-2.yaml, ... Throws IoError.
void SaveStart(const std::filesystem::path& folder);

/// The folder with configs and models: `given` (--data-dir; throws IoError if they are not there),
/// else the environment's VOLALIGN_DATA_DIR, else the folder beside the program. That is the source
/// tree in which it was built, or ../share/volalign of an installed program. "" if none is found.
std::string FindDataFolder(const std::string& given);

/// The message with the path of a page in place of its name, such as docs/formats.md, if it is
/// found. It may be beside the data folder's configs, or in share/doc/volalign of an installed
/// program.
std::string WithPages(std::string message);

/// An addition to a message about a missing file of the data folder, if no data folder was found:
/// how to name it. Else "".
std::string DataFolderHint(const std::string& message);

}  // namespace volalign

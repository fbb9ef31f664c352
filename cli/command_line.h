#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/structure.h"

namespace volalign {

/// A word of a command, in quotes where a shell needs them.
std::string ShellWord(const std::string& word);

/// How the program was called, as a shell reads it.
std::string CommandLine();

/// Keeps the program's arguments for CommandLine, and what the parser made of them for SaveCommand;
/// called once, by main, before a sub-command runs.
void KeepCommand(const CLI::App* program, int argc, const char* const* argv);

/// Writes how a result came about: RESULT/command.yaml where the result is a folder, else
/// RESULT.command.yaml beside it. It has the program's version, the command line, every option of
/// the sub-command as it was used, `configs`: names and YAML of resolved configurations that have
/// no file of their own, and the SHA-256 of a result that is a file. Throws IoError.
void SaveCommand(const std::filesystem::path& result,
                 const std::vector<std::pair<std::string, std::string>>& configs = {});

/// Says on standard error what is doubtful in the description of a stack.
void WarnOf(const Structure& structure);

/// Whether nobody has changed the file since SaveCommand told of it. Throws IoError.
bool IsAsWritten(const std::filesystem::path& file);

/// The same of the start of something that may be started again in its folder: command.yaml, then
/// command-2.yaml, ... Throws IoError.
void SaveStart(const std::filesystem::path& folder);

}  // namespace volalign

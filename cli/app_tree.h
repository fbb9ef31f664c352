#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace volalign {

// The program as the parser's own tables describe it. `path`: the sub-commands' names with spaces
// between, "structure build"; "" is the program.

/// Calls `use` for the app and everything below it, parents first.
void ForEachApp(CLI::App* app, const std::function<void(CLI::App*, const std::string& path)>& use,
                const std::string& path = "");

/// A help with types, limits and defaults in words, not CLI11's names of its checks.
std::shared_ptr<CLI::FormatterBase> HelpFormatter();

/// Gives every sub-command an example at the end of its help (those of cli/examples.cc).
void AddExamples(CLI::App* program);

/// A sentence about the first argument that the parser left, with the nearest name of a sub-command
/// or an option; "" if it left none.
std::string Misspelled(CLI::App* program);

}  // namespace volalign

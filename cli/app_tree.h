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

/// The names of the sub-commands below an app.
std::vector<std::string> CommandNames(const CLI::App* app);

/// The long names of its options, with their dashes.
std::vector<std::string> OptionNames(const CLI::App* app);

/// The words that an option may have as its value; empty if it may have any.
std::vector<std::string> Choices(const CLI::Option* option);

/// The limits of an option's value, in words: "1 to 100", "above 0"; "" without any.
std::string Limits(const CLI::Option* option);

/// A help with types, limits and defaults in words, not CLI11's names of its checks.
std::shared_ptr<CLI::FormatterBase> HelpFormatter();

/// Gives every sub-command an example at the end of its help (those of cli/examples.cc).
void AddExamples(CLI::App* program);

/// A sentence about the first argument that the parser left, with the nearest name of a sub-command
/// or an option; "" if it left none.
std::string Misspelled(CLI::App* program);

/// Markdown of every sub-command: its options and its example.
std::string CommandReference(CLI::App* program);

/// A script for bash that completes sub-commands, options and their choices.
std::string BashCompletion(CLI::App* program);

}  // namespace volalign

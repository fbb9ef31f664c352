#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "core/json/table.h"

namespace volalign {

/// What a command that prints a table writes on standard output: text with the table in it, in the
/// lines of a terminal where it is one, or, with --json or --csv, the table alone.
class TableOutput {
 public:
  void AddOptions(CLI::App* app);
  void Print(const std::string& text, const Table& table) const;
  /// A line beside the table: on standard error where the table is for a program.
  void Say(const std::string& line) const;

 private:
  TableFormat format() const;

  bool json_ = false, csv_ = false;
};

}  // namespace volalign

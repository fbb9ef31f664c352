#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "core/json/table.h"

namespace volalign {

/// The output of a command with a table: text with the table in it or, with --json or --csv, the
/// table alone.
class TableOutput {
 public:
  void AddOptions(CLI::App* app);
  void Print(const std::string& text, const Table& table) const;
  /// Prints a line beside the table: on standard error if the table is for a program.
  void Say(const std::string& line) const;

 private:
  TableFormat format() const;

  bool json_ = false, csv_ = false;
};

}  // namespace volalign

#include "cli/table_output.h"

#include <fmt/format.h>

#include <cstdio>

namespace volalign {

void TableOutput::AddOptions(CLI::App* app) {
  CLI::Option* json = app->add_flag(
      "--json", json_,
      "print the table alone, for a program: a list of objects, in the units that their keys name");
  app->add_flag("--csv", csv_, "the same as CSV")->excludes(json);
}

void TableOutput::Print(const std::string& text, const Table& table) const {
  fmt::print("{}", format() == TableFormat::kText ? text : FormatTable(table, format()));
  std::fflush(stdout);
}

void TableOutput::Say(const std::string& line) const {
  fmt::print(format() == TableFormat::kText ? stdout : stderr, "{}\n", line);
}

TableFormat TableOutput::format() const {
  if (json_) return TableFormat::kJson;
  return csv_ ? TableFormat::kCsv : TableFormat::kText;
}

}  // namespace volalign

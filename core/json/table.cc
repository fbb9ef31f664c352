#include "core/json/table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/base/error.h"
#include "core/base/text.h"

namespace volalign {

namespace {

using Cell = Table::Cell;

std::string ShownNumber(double number, const Table::Column& column) {
  number *= column.scale;
  if (column.digits >= 0) return fmt::format("{:.{}f}", number, column.digits);
  if (std::abs(number) < 1e15 && number == std::round(number)) return fmt::format("{}", number);
  return fmt::format("{:.4g}", number);
}

/// For text if `column` is given, else for a program.
std::string TextOf(const Cell& cell, const Table::Column* column) {
  if (const auto* text = std::get_if<std::string>(&cell)) return Printable(*text);
  if (const auto* holds = std::get_if<bool>(&cell)) return *holds ? "yes" : "no";
  if (const auto* count = std::get_if<std::int64_t>(&cell)) return std::to_string(*count);
  const auto* number = std::get_if<double>(&cell);
  if (!number) return "";
  return column ? ShownNumber(*number, *column) : fmt::format("{}", *number);
}

std::string Quoted(const std::string& text) {
  const std::string quoted = CsvQuoted(text);
  const bool plain = text.find_first_of(",\"\r\n") == std::string::npos;
  return plain && quoted.size() == text.size() + 2 ? text : quoted;
}

std::string AsCsv(const Table& table) {
  std::string csv;
  for (std::size_t i = 0; i < table.columns.size(); ++i)
    csv += (i > 0 ? "," : "") + Quoted(table.columns[i].key);
  csv += "\r\n";
  for (const auto& row : table.rows) {
    for (std::size_t i = 0; i < row.size(); ++i)
      csv += (i > 0 ? "," : "") + Quoted(TextOf(row[i], nullptr));
    csv += "\r\n";
  }
  return csv;
}

bool IsOfNumbers(const Table& table, std::size_t column) {
  return std::all_of(table.rows.begin(), table.rows.end(), [&](const std::vector<Cell>& row) {
    return !std::holds_alternative<std::string>(row[column]) &&
           !std::holds_alternative<bool>(row[column]);
  });
}

/// Has a column no value in any row, if there are rows?
bool HasNoValue(const Table& table, std::size_t column) {
  return !table.rows.empty() &&
         std::all_of(table.rows.begin(), table.rows.end(), [&](const std::vector<Cell>& row) {
           return std::holds_alternative<std::monostate>(row[column]);
         });
}

std::string AsText(const Table& table) {
  std::vector<std::string> lines(table.rows.size() + 1);
  for (std::size_t i = 0; i < table.columns.size(); ++i) {
    const Table::Column& column = table.columns[i];
    if (column.title.empty() || HasNoValue(table, i)) continue;
    std::vector<std::string> cells = {column.title};
    for (const auto& row : table.rows) cells.push_back(TextOf(row[i], &column));
    std::size_t width = 0;
    for (const std::string& cell : cells) width = std::max(width, cell.size());
    const char* layout = IsOfNumbers(table, i) ? "{}{:>{}}" : "{}{:<{}}";
    for (std::size_t k = 0; k < lines.size(); ++k)
      lines[k] += fmt::format(fmt::runtime(layout), lines[k].empty() ? "" : "  ", cells[k], width);
  }
  std::string text;
  for (const std::string& line : lines)
    text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
  return text;
}

std::string AsJson(const Table& table) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const auto& row : table.rows) {
    nlohmann::ordered_json object = nlohmann::ordered_json::object();
    for (std::size_t i = 0; i < row.size(); ++i) {
      const std::string& key = table.columns[i].key;
      if (const auto* text = std::get_if<std::string>(&row[i])) object[key] = Printable(*text);
      if (const auto* holds = std::get_if<bool>(&row[i])) object[key] = *holds;
      if (const auto* count = std::get_if<std::int64_t>(&row[i])) object[key] = *count;
      if (const auto* number = std::get_if<double>(&row[i]); number && std::isfinite(*number))
        object[key] = *number;
    }
    list.push_back(object);
  }
  return list.dump(1) + "\n";
}

}  // namespace

std::string FormatTable(const Table& table, TableFormat format) {
  switch (format) {
    case TableFormat::kText:
      return AsText(table);
    case TableFormat::kCsv:
      return AsCsv(table);
    case TableFormat::kJson:
      return AsJson(table);
  }
  throw Error("invalid TableFormat");
}

}  // namespace volalign

#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace volalign {

/// A table that a command prints, for a person or for a program.
struct Table {
  /// Nothing, a text, a number, a count, or yes or no.
  using Cell = std::variant<std::monostate, std::string, double, std::int64_t, bool>;

  struct Column {
    std::string key;    ///< in JSON and CSV, with the unit: "rms_m"
    std::string title;  ///< in text; empty: left out of it
    /// Format of numbers, but not of counts, in text: a factor, and the digits after the point, or
    /// four digits in all if < 0.
    double scale = 1;
    int digits = -1;

    // NOLINTNEXTLINE(google-explicit-constructor): a key that serves as the title, too.
    Column(const char* name) : Column(std::string(name)) {}
    // NOLINTNEXTLINE(google-explicit-constructor)
    Column(const std::string& name) : key(name), title(name) {}
    Column(std::string in_files, std::string in_text, double factor = 1, int decimals = -1)
        : key(std::move(in_files)), title(std::move(in_text)), scale(factor), digits(decimals) {}
  };

  std::vector<Column> columns;
  std::vector<std::vector<Cell>> rows;
};

inline Table::Cell CellOf(std::size_t count) { return static_cast<std::int64_t>(count); }
inline Table::Cell CellOf(int count) { return std::int64_t{count}; }

enum class TableFormat { kText, kCsv, kJson };

/// kText: aligned columns. kCsv: RFC 4180. kJson: a list of objects, without cells that are empty
/// or not finite. Numbers in CSV and JSON read back exactly.
std::string FormatTable(const Table& table, TableFormat format);

}  // namespace volalign

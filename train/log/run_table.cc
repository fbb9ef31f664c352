#include "train/log/run_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"
#include "train/log/metrics.h"

namespace volalign {
namespace {

using Cell = Table::Cell;

/// Metrics of a validation, in the order of the columns.
constexpr std::array<const char*, 6> kValidationMetrics = {"miou",
                                                           "miou_authors",
                                                           "loss_seg",
                                                           "keypoint_rmse_m",
                                                           "median_translation_error_m",
                                                           "median_rotation_error_deg"};

Cell CellOf(const std::optional<double>& value) { return value ? Cell(*value) : Cell(); }

Cell NumberOf(const LoggedRun& run, const std::string& key) {
  const auto found = run.config.find(key);
  return found == run.config.end() ? Cell() : Cell(std::stod(found->second));
}

/// The best value of a run's own metric.
Cell BestOf(const LoggedRun& run) {
  const auto key = run.config.find("run.best_metric");
  if (key == run.config.end()) return {};
  const auto curve = run.curves.find("validation/" + key->second);
  if (curve == run.curves.end()) return {};
  for (const auto& [word, metric] : kBestMetrics) {
    if (word != key->second) continue;
    const std::vector<double>& v = curve->second.values;
    return LargerIsBetter(metric) ? *std::max_element(v.begin(), v.end())
                                  : *std::min_element(v.begin(), v.end());
  }
  return {};
}

std::pair<Cell, Cell> MeanAndDeviation(const std::vector<double>& values) {
  if (values.empty()) return {};
  double mean = 0, squares = 0;
  for (double v : values) mean += v / static_cast<double>(values.size());
  for (double v : values) squares += (v - mean) * (v - mean);
  if (values.size() < 2) return {mean, Cell()};
  return {mean, std::sqrt(squares / static_cast<double>(values.size() - 1))};
}

std::string TextOf(const Cell& cell, bool exact) {
  if (const auto* text = std::get_if<std::string>(&cell)) return *text;
  const auto* number = std::get_if<double>(&cell);
  if (!number) return "";
  if (exact || (std::abs(*number) < 1e15 && *number == std::round(*number))) {
    return fmt::format("{}", *number);
  }
  return fmt::format("{:.4g}", *number);
}

std::string Quoted(const std::string& text) {
  const std::string quoted = CsvQuoted(text);
  const bool plain = text.find_first_of(",\"\r\n") == std::string::npos;
  return plain && quoted.size() == text.size() + 2 ? text : quoted;
}

std::string AsCsv(const Table& table) {
  std::string csv;
  const auto line = [&](const std::vector<std::string>& cells) {
    for (std::size_t i = 0; i < cells.size(); ++i) csv += (i > 0 ? "," : "") + Quoted(cells[i]);
    csv += "\r\n";
  };
  line(table.columns);
  for (const auto& row : table.rows) {
    std::vector<std::string> cells;
    for (const Cell& cell : row) cells.push_back(TextOf(cell, true));
    line(cells);
  }
  return csv;
}

std::string AsText(const Table& table) {
  std::vector<std::vector<std::string>> lines = {table.columns};
  for (const auto& row : table.rows) {
    lines.emplace_back();
    for (const Cell& cell : row) lines.back().push_back(TextOf(cell, false));
  }
  std::string text;
  std::vector<std::size_t> widths(table.columns.size());
  for (const auto& line : lines) {
    for (std::size_t i = 0; i < line.size(); ++i) widths[i] = std::max(widths[i], line[i].size());
  }
  for (const auto& line : lines) {
    std::string row;
    for (std::size_t i = 0; i < line.size(); ++i)
      row += fmt::format("{:<{}}  ", line[i], widths[i]);
    text += row.substr(0, row.find_last_not_of(' ') + 1) + "\n";
  }
  return text;
}

std::string AsJson(const Table& table) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const auto& row : table.rows) {
    nlohmann::ordered_json object = nlohmann::ordered_json::object();
    for (std::size_t i = 0; i < row.size(); ++i) {
      if (const auto* text = std::get_if<std::string>(&row[i])) object[table.columns[i]] = *text;
      if (const auto* number = std::get_if<double>(&row[i])) object[table.columns[i]] = *number;
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

Table ListRuns(const std::vector<LoggedRun>& runs) {
  Table table;
  table.columns = {"run", "samples", "of", "loss"};
  for (const char* metric : kValidationMetrics) table.columns.emplace_back(metric);
  table.columns.insert(table.columns.end(), {"best_metric", "best", "samples_per_s"});
  for (const LoggedRun& run : runs) {
    std::vector<Cell> row = {run.name, static_cast<double>(run.samples),
                             NumberOf(run, "run.samples"), CellOf(run.Last("train/loss"))};
    for (const char* metric : kValidationMetrics) {
      row.push_back(CellOf(run.Last(std::string("validation/") + metric)));
    }
    const auto key = run.config.find("run.best_metric");
    row.push_back(key == run.config.end() ? Cell() : Cell(key->second));
    row.push_back(BestOf(run));
    row.push_back(CellOf(run.SamplesPerSecond()));
    table.rows.push_back(row);
  }
  return table;
}

Table CompareRuns(const std::vector<RunGroup>& groups) {
  Table table;
  if (groups.empty()) return table;
  table.columns.emplace_back("run");
  for (const auto& [key, unused] : groups.front().differences) table.columns.push_back(key);
  table.columns.insert(table.columns.end(), {"runs", "samples"});
  std::vector<std::string> metrics;
  for (const char* metric : kValidationMetrics) metrics.emplace_back(metric);
  metrics.emplace_back("samples_per_s");
  for (const std::string& metric : metrics) {
    table.columns.push_back(metric);
    table.columns.push_back(metric + " std");
  }
  for (const RunGroup& group : groups) {
    std::vector<Cell> row = {group.runs.front().name};
    for (const auto& [key, value] : group.differences) row.emplace_back(value);
    row.emplace_back(static_cast<double>(group.runs.size()));
    const auto least = std::min_element(
        group.runs.begin(), group.runs.end(),
        [](const LoggedRun& a, const LoggedRun& b) { return a.samples < b.samples; });
    row.emplace_back(static_cast<double>(least->samples));
    for (const std::string& metric : metrics) {
      std::vector<double> values;
      for (const LoggedRun& run : group.runs) {
        const auto value =
            metric == "samples_per_s" ? run.SamplesPerSecond() : run.Last("validation/" + metric);
        if (value) values.push_back(*value);
      }
      const auto [mean, deviation] = MeanAndDeviation(values);
      row.push_back(mean);
      row.push_back(deviation);
    }
    table.rows.push_back(row);
  }
  return table;
}

}  // namespace volalign

#pragma once

#include <optional>
#include <string>
#include <vector>

#include "infer/evaluate/suite/scores.h"
#include "infer/evaluate/suite/suite_config.h"

namespace volalign {

/// One metric of one row over a block's captures.
struct TableCell {
  bool applicable = true;
  std::vector<double> values;  ///< of each placed view, or of each capture with one
  ColumnStatistics column;
  std::optional<double> distance;  ///< to the best mean of the rows that the paper has
  std::optional<double> floor;  ///< mean of the metric at the true poses, of all views or captures
};

/// Pose errors and failures of one row over a block's captures, by the truth of rendering.
struct TableTruth {
  int views = 0, lost = 0;
  int measured = 0;  ///< placed, with a ground truth
  int wrong = 0;     ///< over 10 cm or 5 deg off, among these
  double mean_mm = 0, median_mm = 0, mean_deg = 0, median_deg = 0;
  std::optional<double> miou_of_truth;  ///< mean of the labels' plain mIoU against the true ones
};

struct TableRowData {
  SuiteRow row;
  bool has_model = true;
  std::vector<TableCell> cells;   ///< of the table's blocks
  std::vector<TableTruth> truth;  ///< likewise
};

struct TableData {
  SuiteTable table;
  std::vector<TableRowData> rows;
};

TableData MakeTable(const SuiteConfig& suite, const SuiteTable& table,
                    const std::vector<CaptureScores>& scores);

/// A table for people: our figure of each cell with the paper's in brackets, and floors. Then come
/// pose errors, failures and each set-up's own spread.
std::string FormatMarkdown(const TableData& table);
/// All numbers, a row for each cell of the table.
std::string FormatTableCsv(const TableData& table);
/// All numbers, with the single values behind them.
std::string FormatTableJson(const TableData& table);

}  // namespace volalign

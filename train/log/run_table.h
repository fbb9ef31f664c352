#pragma once

#include <string>
#include <variant>
#include <vector>

#include "train/log/run_log.h"

namespace volalign {

/// Cells are texts, numbers, or nothing.
struct Table {
  using Cell = std::variant<std::monostate, std::string, double>;
  std::vector<std::string> columns;
  std::vector<std::vector<Cell>> rows;
};

enum class TableFormat { kText, kCsv, kJson };

/// kText: aligned columns, numbers with 4 digits. kCsv: RFC 4180. kJson: a list of objects, without
/// the cells that have nothing. Numbers of the latter two read back exactly.
std::string FormatTable(const Table& table, TableFormat format);

/// One row per run: samples, of how many, the last validation, the best value of run.best_metric,
/// the last loss, samples per second.
Table ListRuns(const std::vector<LoggedRun>& runs);

/// One row per group: the folder of its first run, the keys that differ, the number of seeds, and
/// of each metric of the last validation its mean over the seeds and, for two and more, its
/// standard deviation.
Table CompareRuns(const std::vector<RunGroup>& groups);

}  // namespace volalign

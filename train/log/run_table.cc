#include "train/log/run_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

#include "core/base/number.h"

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

/// Nothing if the run's configuration has no such number.
std::optional<double> NumberOf(const LoggedRun& run, const std::string& key) {
  const auto found = run.config.find(key);
  return found == run.config.end() ? std::nullopt : volalign::NumberOf(found->second);
}

Cell BestOf(const LoggedRun& run) {
  const auto curve = run.curves.find("validation/miou");
  if (curve == run.curves.end()) return {};
  return *std::max_element(curve->second.values.begin(), curve->second.values.end());
}

std::pair<Cell, Cell> MeanAndDeviation(const std::vector<double>& values) {
  if (values.empty()) return {};
  double mean = 0, squares = 0;
  for (double v : values) mean += v / static_cast<double>(values.size());
  for (double v : values) squares += (v - mean) * (v - mean);
  if (values.size() < 2) return {mean, Cell()};
  return {mean, std::sqrt(squares / static_cast<double>(values.size() - 1))};
}

/// Half of the 95 % interval of a mean of `n` normal values, divided by their standard error:
/// Student's t.
double HalfInterval95(std::size_t n) {
  constexpr std::array<double, 10> kFew = {12.706, 4.303, 3.182, 2.776, 2.571,
                                           2.447,  2.365, 2.306, 2.262, 2.228};
  if (n - 2 < kFew.size()) return kFew[n - 2];
  // Cornish and Fisher's expansion, here within 0.1 %.
  constexpr double kZ = 1.959964;
  const auto freedom = static_cast<double>(n - 1);
  return kZ + (std::pow(kZ, 3) + kZ) / (4 * freedom) +
         (5 * std::pow(kZ, 5) + 16 * std::pow(kZ, 3) + 3 * kZ) / (96 * freedom * freedom);
}

/// Difference of `group` from `first` in `metric` for the same seeds: the number of these seeds,
/// the mean difference and half of its 95 % interval.
std::array<Cell, 3> DifferenceFrom(const RunGroup& first, const RunGroup& group,
                                   const std::string& metric) {
  const auto by_seeds = [&](const RunGroup& runs) {
    std::map<double, double> values;
    for (const LoggedRun& run : runs.runs) {
      const auto value = run.Last("validation/" + metric);
      if (value) values[NumberOf(run, "run.seed").value_or(-1)] = *value;
    }
    return values;
  };
  const auto reference = by_seeds(first), own = by_seeds(group);
  std::vector<double> differences;
  for (const auto& [seeds, value] : own) {
    const auto at = reference.find(seeds);
    if (at != reference.end()) differences.push_back(value - at->second);
  }
  const std::size_t n = differences.size();
  const auto [mean, deviation] = MeanAndDeviation(differences);
  if (n < 2) return {volalign::CellOf(n), mean, Cell()};
  return {volalign::CellOf(n), mean,
          HalfInterval95(n) * std::get<double>(deviation) / std::sqrt(static_cast<double>(n))};
}

}  // namespace

Table ListRuns(const std::vector<LoggedRun>& runs) {
  Table table;
  table.columns = {"run", "samples", "of", "loss"};
  for (const char* metric : kValidationMetrics) table.columns.emplace_back(metric);
  table.columns.insert(table.columns.end(), {"best miou", "samples_per_s"});
  for (const LoggedRun& run : runs) {
    std::vector<Cell> row = {run.name, std::int64_t{run.samples},
                             CellOf(NumberOf(run, "run.samples")), CellOf(run.Last("train/loss"))};
    for (const char* metric : kValidationMetrics) {
      row.push_back(CellOf(run.Last(std::string("validation/") + metric)));
    }
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
  if (groups.size() > 1)
    table.columns.insert(table.columns.end(), {"shared seeds", "miou less the first's", "95 % +-"});
  for (const RunGroup& group : groups) {
    std::vector<Cell> row = {group.runs.front().name};
    for (const auto& [key, value] : group.differences) row.emplace_back(value);
    row.push_back(volalign::CellOf(group.runs.size()));
    const auto least = std::min_element(
        group.runs.begin(), group.runs.end(),
        [](const LoggedRun& a, const LoggedRun& b) { return a.samples < b.samples; });
    row.emplace_back(std::int64_t{least->samples});
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
    if (&group != &groups.front()) {
      for (const Cell& cell : DifferenceFrom(groups.front(), group, "miou")) row.push_back(cell);
    } else if (groups.size() > 1) {
      row.resize(table.columns.size());
    }
    table.rows.push_back(row);
  }
  return table;
}

}  // namespace volalign

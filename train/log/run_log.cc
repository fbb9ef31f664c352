#include "train/log/run_log.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <system_error>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/number.h"
#include "core/base/statistics.h"
#include "core/base/text.h"
#include "core/config/config.h"

namespace volalign {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

/// Finds the runs in and below a folder. `passed_over` receives those that cannot be read, with the
/// reason; the others are found all the same.
void FindRuns(const fs::path& dir, bool below, std::vector<fs::path>* found,
              std::vector<std::string>* passed_over) {
  std::error_code error;
  const bool is_run = fs::exists(dir / "config.yaml", error) && !error &&
                      fs::exists(dir / "metrics.jsonl", error) && !error;
  if (is_run) found->push_back(dir);
  fs::directory_iterator entry;
  if (!error && below) entry = fs::directory_iterator(dir, error);
  while (!error && entry != fs::directory_iterator()) {
    std::error_code unseen;
    if (entry->is_directory(unseen))
      FindRuns(entry->path(), !entry->is_symlink(unseen), found, passed_over);
    entry.increment(error);
  }
  if (error && error != std::errc::no_such_file_or_directory)
    passed_over->push_back(fmt::format("{}: {}", ShownPath(dir), error.message()));
}

void AddRow(const json& row, LoggedRun* run) {
  std::map<std::string, double>& last = run->last[row.at("type").get<std::string>()];
  if (!row.at("samples").is_number_integer())
    throw DataError(
        fmt::format("samples = {} is no whole number", Shortened(row["samples"].dump())));
  run->samples = std::max(run->samples, row.at("samples").get<std::int64_t>());
  last.clear();
  for (const auto& [key, value] : row.items()) {
    if (value.is_number()) last[key] = value.get<double>();
  }
  if (last.count("miou") > 0) run->miou.push_back(last["miou"]);
  if (last.count("samples_per_s") > 0) run->samples_per_s.push_back(last["samples_per_s"]);
}

std::string ValueOf(const LoggedRun& run, const std::string& key) {
  const auto found = run.config.find(key);
  return found == run.config.end() ? std::string() : found->second;
}

}  // namespace

std::optional<double> LoggedRun::Last(const std::string& type, const std::string& metric) const {
  const auto row = last.find(type);
  if (row == last.end() || row->second.count(metric) == 0) return std::nullopt;
  return row->second.at(metric);
}

std::optional<double> LoggedRun::SamplesPerSecond() const {
  if (samples_per_s.empty()) return std::nullopt;
  return Quantile(samples_per_s, 0.5);
}

LoggedRun ReadRun(const fs::path& dir) {
  LoggedRun run;
  run.name = dir.string();
  const ConfigSource source = ConfigSource::FromFile((dir / "config.yaml").string());
  for (const auto& [key, leaf] : source.Leaves()) run.config[key] = FlowText(leaf);
  std::istringstream rows(ReadFile(dir / "metrics.jsonl", kMaxLogBytes));
  int number = 0;
  for (std::string text; std::getline(rows, text);) {
    ++number;
    try {
      AddRow(json::parse(text), &run);
    } catch (const std::exception& e) {
      if (rows.eof()) break;  // an incomplete row of a killed run
      throw DataError(fmt::format("{}:{}: not a row of a training log ({})",
                                  (dir / "metrics.jsonl").string(), number, Shortened(e.what())));
    }
  }
  return run;
}

std::vector<LoggedRun> ReadRuns(const std::vector<std::string>& folders,
                                std::vector<std::string>* passed_over) {
  std::vector<LoggedRun> runs;
  std::vector<std::string> unseen;
  for (const std::string& folder : folders) {
    std::vector<fs::path> found;
    FindRuns(folder, true, &found, &unseen);
    if (found.empty()) {
      throw IoError(
          fmt::format("{}: no run here or below: a run folder has config.yaml and metrics.jsonl{}",
                      folder, unseen.empty() ? "" : fmt::format(" ({})", unseen.back())));
    }
    std::sort(found.begin(), found.end());
    for (const fs::path& dir : found) runs.push_back(ReadRun(dir));
  }
  if (passed_over) *passed_over = std::move(unseen);
  return runs;
}

std::vector<RunGroup> GroupRuns(const std::vector<LoggedRun>& runs) {
  std::set<std::string> keys, differing;
  for (const LoggedRun& run : runs) {
    for (const auto& [key, unused] : run.config) keys.insert(key);
  }
  for (const std::string& key : keys) {
    if (key == "run.seed") continue;  // in this the runs of a group may differ
    for (const LoggedRun& run : runs) {
      if (ValueOf(run, key) != ValueOf(runs.front(), key)) differing.insert(key);
    }
  }
  std::vector<RunGroup> groups;
  for (const LoggedRun& run : runs) {
    std::map<std::string, std::string> own;
    for (const std::string& key : differing) own[key] = ValueOf(run, key);
    auto group = std::find_if(groups.begin(), groups.end(),
                              [&](const RunGroup& g) { return g.differences == own; });
    if (group == groups.end()) group = groups.insert(groups.end(), RunGroup{own, {}});
    group->runs.push_back(run);
  }
  return groups;
}

void ShowKeys(const std::vector<std::string>& keys, std::vector<RunGroup>* groups) {
  for (const std::string& key : keys) {
    const bool known = std::any_of(groups->begin(), groups->end(), [&](const RunGroup& group) {
      return group.runs.front().config.count(key) > 0;
    });
    if (!known) throw ConfigError(fmt::format("--keys {}: no run has this key", key));
  }
  for (RunGroup& group : *groups) {
    group.differences.clear();
    for (const std::string& key : keys) group.differences[key] = ValueOf(group.runs.front(), key);
  }
}

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

std::pair<Cell, Cell> MeanAndDeviation(const std::vector<double>& values) {
  if (values.empty()) return {};
  double mean = 0, squares = 0;
  for (double v : values) mean += v / static_cast<double>(values.size());
  for (double v : values) squares += (v - mean) * (v - mean);
  if (values.size() < 2) return {mean, Cell()};
  return {mean, std::sqrt(squares / static_cast<double>(values.size() - 1))};
}

}  // namespace

Table ListRuns(const std::vector<LoggedRun>& runs) {
  Table table;
  table.columns = {"run", "samples", "of", "loss"};
  for (const char* metric : kValidationMetrics) table.columns.emplace_back(metric);
  table.columns.insert(table.columns.end(), {"best miou", "samples_per_s"});
  for (const LoggedRun& run : runs) {
    std::vector<Cell> row = {run.name, std::int64_t{run.samples},
                             CellOf(NumberOf(ValueOf(run, "run.samples"))),
                             CellOf(run.Last("train", "loss"))};
    for (const char* metric : kValidationMetrics) {
      row.push_back(CellOf(run.Last("validation", metric)));
    }
    const auto best = std::max_element(run.miou.begin(), run.miou.end());
    row.push_back(best == run.miou.end() ? Cell() : Cell(*best));
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
  std::vector<std::string> metrics(kValidationMetrics.begin(), kValidationMetrics.end());
  metrics.emplace_back("samples_per_s");
  for (const std::string& metric : metrics) {
    table.columns.push_back(metric);
    table.columns.push_back(metric + " std");
  }
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
            metric == "samples_per_s" ? run.SamplesPerSecond() : run.Last("validation", metric);
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

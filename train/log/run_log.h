#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/json/table.h"

namespace volalign {

/// The content of a run folder, of a finished or unfinished run.
struct LoggedRun {
  std::string name;                           ///< the folder, as it was given
  std::map<std::string, std::string> config;  ///< every key of config.yaml, as text
  std::int64_t samples = 0;                   ///< of the last row
  /// The numbers of the last row of each type: train, validation.
  std::map<std::string, std::map<std::string, double>> last;
  std::vector<double> miou, samples_per_s;  ///< of all rows

  /// Nothing if the last row of that type does not have the number.
  std::optional<double> Last(const std::string& type, const std::string& metric) const;
  std::optional<double> SamplesPerSecond() const;  ///< median over the rows
};

/// Reads a run folder. Throws IoError if config.yaml or metrics.jsonl is missing. Throws DataError
/// if a row other than the last is no JSON.
LoggedRun ReadRun(const std::filesystem::path& dir);

/// The runs in these folders and below them, in the order of the arguments, below by name. Throws
/// IoError for a folder without runs. `passed_over` receives the folders that cannot be read, with
/// the reason.
std::vector<LoggedRun> ReadRuns(const std::vector<std::string>& folders,
                                std::vector<std::string>* passed_over = nullptr);

/// Runs whose configurations differ only in run.seed.
struct RunGroup {
  std::map<std::string, std::string> differences;  ///< keys that differ between groups
  std::vector<LoggedRun> runs;
};

/// Groups runs. Groups are in the order of their first runs.
std::vector<RunGroup> GroupRuns(const std::vector<LoggedRun>& runs);

/// Gives all groups these keys as their `differences`, whether they differ or not. Throws
/// ConfigError for a key that no run has.
void ShowKeys(const std::vector<std::string>& keys, std::vector<RunGroup>* groups);

/// One row per run: samples, run.samples, the last loss, the last validation, the best miou, and
/// samples per second.
Table ListRuns(const std::vector<LoggedRun>& runs);

/// One row per group: the folder of its first run, the keys that differ, the number of runs, and
/// the fewest samples. Then each metric of the last validation, and samples per second: the mean
/// over the runs and, for two or more, the standard deviation.
Table CompareRuns(const std::vector<RunGroup>& groups);

}  // namespace volalign

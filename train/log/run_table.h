#pragma once

#include <vector>

#include "core/json/table.h"
#include "train/log/run_log.h"

namespace volalign {

/// One row per run: samples, run.samples, the last loss, the last validation, the best miou, and
/// samples per second.
Table ListRuns(const std::vector<LoggedRun>& runs);

/// One row per group: the folder of its first run, the keys that differ, the number of runs, and
/// the fewest samples. Then each metric of the last validation, and samples per second: the mean
/// over the runs and, for two or more, the standard deviation. All groups but the first have the
/// difference of their miou from the first group's runs with the same seeds. It is the mean and,
/// for two seeds or more, half of its 95 % interval (Student's t).
Table CompareRuns(const std::vector<RunGroup>& groups);

}  // namespace volalign

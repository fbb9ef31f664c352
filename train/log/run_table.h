#pragma once

#include <vector>

#include "core/json/table.h"
#include "train/log/run_log.h"

namespace volalign {

/// One row per run: samples, of how many, the last validation, its best miou, the
/// last loss, samples per second.
Table ListRuns(const std::vector<LoggedRun>& runs);

/// One row per group: the folder of its first run, the keys that differ, the number of seeds, and
/// of each metric of the last validation its mean over the seeds and, for two and more, its
/// standard deviation. Of each group but the first, how far its miou is from that of the
/// first group's runs with the same seeds: the mean and, for two seeds and more, half of its 95 %
/// interval (Student's t).
Table CompareRuns(const std::vector<RunGroup>& groups);

}  // namespace volalign

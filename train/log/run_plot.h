#pragma once

#include <string>
#include <vector>

#include "train/log/run_log.h"

namespace volalign {

/// A picture of curves as SVG: a panel for each metric ("train/loss", "validation/miou"), in it a
/// line for each group, the mean of its runs, in a band from the least to the largest of them. A
/// line goes as far as all runs of its group have come. Throws ConfigError for a metric that no run
/// has, naming those that there are.
std::string PlotRuns(const std::vector<RunGroup>& groups, const std::vector<std::string>& metrics);

}  // namespace volalign

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "infer/evaluate/suite/scores.h"
#include "infer/evaluate/suite/suite_config.h"

namespace volalign {

/// Writes into a folder, for each table, TABLE.md, .csv and .json; and suite.md, all tables, and
/// suite.json, the scores. Returns suite.md's text.
std::string WriteSuite(const std::filesystem::path& folder, const SuiteConfig& suite,
                       const std::vector<CaptureScores>& scores);

}  // namespace volalign

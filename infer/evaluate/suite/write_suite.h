#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "infer/evaluate/suite/scores.h"
#include "infer/evaluate/suite/suite_config.h"

namespace volalign {

/// Writes TABLE.md, .csv and .json for each table into a folder, suite.md with all tables, and
/// suite.json with the scores. Returns suite.md's text.
std::string WriteSuite(const std::filesystem::path& folder, const SuiteConfig& suite,
                       const std::vector<CaptureScores>& scores);

}  // namespace volalign

#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/base/progress_line.h"
#include "infer/evaluate/suite/scores.h"
#include "infer/evaluate/suite/suite_config.h"
#include "render/depth_renderer.h"

namespace volalign {

struct SuiteRun {
  std::filesystem::path output;   ///< results go to captures/ in it and are not computed again
  std::string program;            ///< identifies the program's build
  int workers = 1;                ///< captures that are computed at the same time
  RendererFactory make_renderer;  ///< called by each worker that renders
  int max_captures = 0;           ///< of each dataset, evenly taken; 0: all
  std::function<void(const std::string& line)> progress;  ///< one line per capture
  CountDone count;                                        ///< of captures
};

/// Runs every method whose model exists on every capture. Returns all results, in order of
/// datasets, captures and methods. Each result is written at once. It is computed again only if the
/// program, the capture, the model or an option has changed. Throws what reading, rendering and
/// calibration throw.
std::vector<CaptureScores> RunSuite(const SuiteConfig& suite, const SuiteRun& run);

/// Writes TABLE.md, .csv and .json for each table into a folder, suite.md with all tables, and
/// suite.json with the scores. Returns suite.md's text.
std::string WriteSuite(const std::filesystem::path& folder, const SuiteConfig& suite,
                       const std::vector<CaptureScores>& scores);

}  // namespace volalign

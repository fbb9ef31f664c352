#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/base/progress_line.h"
#include "core/geometry/rig.h"
#include "core/geometry/structure.h"
#include "infer/evaluate/items.h"
#include "infer/evaluate/suite/scores.h"
#include "infer/evaluate/suite/suite_config.h"
#include "render/depth_renderer.h"

namespace volalign {

/// A capture of a suite, to be rendered or read when its turn comes.
struct SuiteItem {
  std::string dataset, set_up, capture;
  std::optional<Rig> rig;  ///< to render; else a recording
  EvaluationItem recording;
};

/// At most `most` captures of a dataset, evenly taken (0: all): the turns of its rigs, then its
/// recordings. Recordings are of `structure` unless they name another. Throws what reading rigs and
/// captures throws.
std::vector<SuiteItem> SuiteItems(const SuiteDataset& dataset, const Structure& structure,
                                  int most);

/// Does the method apply to the capture? Some are for one dataset, and recordings have no markers.
bool Applies(const SuiteMethod& method, const SuiteItem& item);

struct SuiteRun {
  std::filesystem::path output;   ///< scores go to captures/ in it
  int workers = 1;                ///< captures that are computed at the same time
  RendererFactory make_renderer;  ///< called by each worker that renders
  int max_captures = 0;           ///< of each dataset, evenly taken; 0: all
  std::function<void(const std::string& line)> progress;  ///< one line per capture
  CountDone count;                                        ///< of captures
};

/// Runs every method whose model exists on every capture. Returns all results, in order of
/// datasets, captures and methods. Throws what reading, rendering and calibration throw.
std::vector<CaptureScores> RunSuite(const SuiteConfig& suite, const SuiteRun& run);

/// Writes suite.md with all tables, TABLE.json for each, and suite.json with the scores into a
/// folder. Returns suite.md's text.
std::string WriteSuite(const std::filesystem::path& folder, const SuiteConfig& suite,
                       const std::vector<CaptureScores>& scores);

}  // namespace volalign

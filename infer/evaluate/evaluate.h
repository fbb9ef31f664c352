#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/base/progress_line.h"
#include "core/geometry/structure.h"
#include "infer/evaluate/items.h"
#include "infer/evaluate/measure.h"
#include "infer/evaluate/storage.h"
#include "infer/evaluate/variants.h"
#include "infer/view/segmenter.h"

namespace volalign {

/// A network whose calibrations are measured.
struct EvaluationModel {
  CheckpointFile checkpoint;
  Segmenter* segmenter;
  const Structure* structure;  ///< a still whose structure has other sides is an error
};

struct EvaluateRun {
  std::filesystem::path output;  ///< evaluation.json; what is in it is not done again
  std::string program;           ///< identifies the program's build
  std::function<void()> begin;   ///< called when `output` has none but this run's results
  std::function<void(const std::string& line)> progress;  ///< one line per still
  CountDone count;                                        ///< of the stills that are not done yet
};

/// Evaluates every item with each model under every variant and writes `output` after each still
/// (atomically), so that a killed run continues where it was. Results in it that another program,
/// model, option or still gave are dropped. With several models, a case's variant is named after
/// its checkpoint's file too: "m05", or "m05, network". Throws what loading, rendering and
/// calibration throw, ConfigError for two checkpoints of one name, and DataError for an `output`
/// that is no evaluation.
std::vector<EvaluatedCase> Evaluate(const std::vector<EvaluationItem>& items,
                                    const std::vector<EvaluationVariant>& variants,
                                    const std::vector<EvaluationModel>& models,
                                    const EvaluateRun& run);

}  // namespace volalign

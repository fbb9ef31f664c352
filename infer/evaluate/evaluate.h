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
  const Structure* structure;  ///< a capture whose structure has other sides is an error
};

struct EvaluateRun {
  std::filesystem::path output;  ///< evaluation.json; results in it are not computed again
  std::string program;           ///< identifies the program's build
  std::function<void()> begin;   ///< called when `output` has only this run's results
  std::function<void(const std::string& line)> progress;  ///< one line per capture
  CountDone count;                                        ///< of the captures that are not done yet
};

/// Evaluates every item with each model under every variant. It writes `output` atomically after
/// each capture, so that a killed run continues where it was. Results of another program, model,
/// option or capture in it are dropped. With several models, a case's variant has the name of its
/// checkpoint's file too: "m05", or "m05, network". Throws what loading, rendering and calibration
/// throw, ConfigError for two checkpoints of one name, and DataError for an `output` that is no
/// evaluation.
std::vector<EvaluatedCase> Evaluate(const std::vector<EvaluationItem>& items,
                                    const std::vector<EvaluationVariant>& variants,
                                    const std::vector<EvaluationModel>& models,
                                    const EvaluateRun& run);

}  // namespace volalign

#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/structure.h"
#include "infer/evaluate/items.h"
#include "infer/evaluate/measure.h"
#include "infer/evaluate/variants.h"
#include "infer/view/segmenter.h"

namespace volalign {

struct EvaluateRun {
  std::filesystem::path output;  ///< evaluation.json; what is in it is not done again
  std::string model_file, model_sha256;
  std::string program;                                    ///< identifies the program's build
  std::function<void(const std::string& line)> progress;  ///< a line a still
};

/// Evaluates every item under every variant and writes `output` after each still (atomically), so
/// that a killed run continues where it was. Results in it that another program, model, option or
/// still gave are dropped. `structure` is the network's: a still whose structure has other sides is
/// an error. Throws what loading, rendering and calibration throw, and DataError for an `output`
/// that is no evaluation.
std::vector<EvaluatedCase> Evaluate(const std::vector<EvaluationItem>& items,
                                    const std::vector<EvaluationVariant>& variants,
                                    Segmenter& segmenter, const Structure& structure,
                                    const EvaluateRun& run);

}  // namespace volalign

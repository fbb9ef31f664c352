#pragma once

#include <string>
#include <vector>

#include "infer/evaluate/measure.h"

namespace volalign {

/// Markdown: accuracy; placement and intervals; one row a sensor of every capture.
std::string FormatEvaluation(const std::vector<EvaluatedCase>& cases);

}  // namespace volalign

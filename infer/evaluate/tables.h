#pragma once

#include <string>
#include <vector>

#include "core/json/table.h"
#include "infer/evaluate/measure.h"

namespace volalign {

/// Markdown tables: accuracy; placement and intervals; one row for each sensor of every capture.
std::string FormatEvaluation(const std::vector<EvaluatedCase>& cases);

/// The same for a program: a row for each EvaluationSummary, then one for each sensor of a capture
/// without ground truth. Errors are in mm and deg, shares from 0 to 1.
Table EvaluationTable(const std::vector<EvaluatedCase>& cases);

}  // namespace volalign

#pragma once

#include <string>
#include <vector>

#include "core/json/table.h"
#include "infer/evaluate/measure.h"

namespace volalign {

/// Did the sensor fail although the sides that it truly sees fix a pose?
bool IsLost(const EvaluatedSensor& sensor);
/// Is the error more than 10 cm or 5 deg?
bool IsWrong(const PoseError& error);
bool IsWrong(const EvaluatedSensor& sensor);  ///< of its refined pose, by the nominal boxes

struct ErrorStatistics {
  double median = 0, p95 = 0, max = 0;
};

/// Of the placed sensors with a ground truth.
struct PoseStatistics {
  ErrorStatistics initial_mm, initial_deg, refined_mm, refined_deg;
  /// Shares of the six components of all sensors within their central 68 % and 95 % intervals.
  double cover68 = 0, cover95 = 0;
};

/// Statistics of the placed sensors with a ground truth, for one rig (or "all"), one choice of
/// sensors, one number of placements and one variant.
struct EvaluationSummary {
  std::string rig, sensors;
  int placements = 1;
  std::string variant;
  int count = 0, placed = 0, weak = 0;
  int fixable = 0;  ///< sensors whose true sides fix a pose
  int lost = 0;     ///< failed sensors among these
  int wrong = 0;    ///< placed, over 10 cm or 5 deg off
  int measured = 0;
  PoseStatistics nominal, built;  ///< as of EvaluatedSensor
};

/// One summary per rig, sensors, number of placements and variant, in order of appearance, then
/// pooled over rigs, then over all. Cases without any ground truth are left out.
std::vector<EvaluationSummary> SummariseCases(const std::vector<EvaluatedCase>& cases);

/// A row for each EvaluationSummary, then one for each sensor of a capture without ground truth.
/// Errors are in mm and deg, shares from 0 to 1.
Table EvaluationTable(const std::vector<EvaluatedCase>& cases);

/// The same for a person: accuracy, placement and intervals, sensors that were lost or placed
/// wrong, and the sensors of captures.
std::string FormatEvaluation(const std::vector<EvaluatedCase>& cases);

}  // namespace volalign

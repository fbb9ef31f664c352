#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cli/table_output.h"
#include "core/geometry/structure.h"
#include "infer/calib/result.h"
#include "infer/report/extrinsics.h"
#include "infer/report/html_report/payload.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// What the sub-commands that calibrate a capture have in common.
struct CalibrationRequest {
  std::vector<std::string> captures;
  std::string model = "shipped", output, config, structure, initial, estimate, note;
  std::vector<std::string> assignments, choose;
  bool no_report = false;
  TableOutput table;
  /// Of an earlier calibration, with which this one is compared: a model's own structure may not
  /// stand in for another one.
  std::optional<Extrinsics::StructureId> last_structure;
};

/// All options but --output and --capture, whose meaning is the sub-command's.
void AddCalibrationOptions(CLI::App* app, CalibrationRequest* request);

struct Calibration {
  std::vector<Still> stills;
  Structure structure;
  CalibrationResult result;
  ExtrinsicsSource source;
  std::string options;    ///< YAML: every option of the calibration
  bool replaced = false;  ///< the folder had a result already
};

/// What the report says of how it was made, and what else the caller finds in the result.
using CompleteReport = std::function<void(const Calibration& calibration, ReportRun* report)>;

/// Reads, calibrates, says which model it takes and why, and writes the folder `request.output`
/// where that is not empty. `complete` is called before anything is written, with what the report
/// will have. Throws what these throw.
Calibration RunCalibration(const CalibrationRequest& request, const CompleteReport& complete = {});

/// A line on what RunCalibration wrote.
std::string WrittenBy(const CalibrationRequest& request, const Calibration& calibration);

}  // namespace volalign

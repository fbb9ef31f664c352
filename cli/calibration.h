#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cli/table_output.h"
#include "infer/report/export.h"

namespace volalign {

/// The common options of the sub-commands that calibrate a capture.
struct CalibrationRequest {
  std::vector<std::string> captures;
  std::string model = "shipped", output, config, structure, initial, estimate, note, world;
  std::vector<std::string> assignments, choose;
  /// Poses that are known beforehand: file, its format, standard deviations, and scale of the
  /// world.
  std::string prior, prior_from = "volalign", prior_scale = "metric";
  std::vector<double> prior_sigma;
  bool no_report = false;
  TableOutput table;
  /// The structure of an earlier calibration for comparison; a model's own structure may not stand
  /// in for another one.
  std::optional<Extrinsics::StructureId> last_structure;
};

/// Adds all options but --output and --capture, which the sub-commands define.
void AddCalibrationOptions(CLI::App* app, CalibrationRequest* request);

struct WrittenCalibration : Calibration {
  std::string written;  ///< a line on the files
};

/// Completes the report of how the result was made, or uses the result.
using CompleteReport = std::function<void(const Calibration& calibration, ReportRun* report)>;

/// Reads, calibrates, says which model it uses and why, and writes the folder `request.output`
/// unless that is empty. `complete` is called before anything is written, with the report's
/// content. Throws what these throw.
WrittenCalibration RunCalibration(const CalibrationRequest& request,
                                  const CompleteReport& complete = {});

}  // namespace volalign

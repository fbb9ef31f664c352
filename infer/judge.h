#pragma once

#include <optional>
#include <vector>

#include "infer/checks/assembly.h"
#include "infer/checks/depth_checks.h"
#include "infer/checks/placement.h"
#include "infer/pose/orientation.h"
#include "infer/refine/refine.h"
#include "infer/result.h"
#include "infer/view/sensor_frame.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// What the stages of a calibration found, one element a frame but for `refined`, which has the
/// placed sensors in order.
struct StageResults {
  std::vector<DepthFinding> depths;
  std::vector<SensorView> views;
  std::vector<LabelledView> labelled;
  std::vector<Placement> placements;
  std::optional<AssemblyReport> assembly;
  RefineResult refined;
  LensSet lenses;  ///< of the views
  std::vector<std::optional<Finding>> suspect_lenses;
};

struct JudgeOptions {
  const VerdictOptions& verdict;
  double min_confidence;  ///< of a label that counts
  int threads = 1;
};

/// The last stage: measures every placed sensor at its reported pose, judges it, and gathers the
/// result (without timings_s).
CalibrationResult JudgeSensors(const std::vector<SensorFrame>& frames, const Structure& structure,
                               StageResults stages, const JudgeOptions& options);

}  // namespace volalign

#pragma once

#include <optional>

#include "infer/calib/calibrate.h"
#include "infer/calib/joint_solution.h"
#include "infer/calib/result.h"
#include "infer/checks/outcome.h"
#include "infer/view/frames.h"

namespace volalign {

/// The last stage: measures every located frame at its reported pose, judges it, and gathers the
/// result (without timings_s). `stack` and `suspect_lenses`: findings of the stages before.
CalibrationResult Judge(Joint joint, const StackFinding& stack,
                        const PerFrame<std::optional<Finding>>& suspect_lenses,
                        const CalibrateOptions& options);

}  // namespace volalign

#pragma once

#include <optional>
#include <vector>

#include "infer/calib/calibrate.h"
#include "infer/calib/joint_solution.h"
#include "infer/calib/result.h"
#include "infer/checks/outcome.h"
#include "infer/view/frames.h"

namespace volalign {

/// Does this code mean that the stack may not look as described?
bool FailedToFindStack(SensorCode code);

/// Does a sensor's finding call for other arrangements of the stack? It did not find the stack,
/// fits it badly, or contradicts others at the only pose that it has.
bool QuestionsStack(const SensorOutcome& sensor, const std::vector<RigAlternative>& alternatives);

/// The last stage. It measures every located frame at its reported pose, judges it, and gathers the
/// result (without timings_s). `stack` and `suspect_lenses` are findings of earlier stages.
CalibrationResult Judge(Joint joint, const StackFinding& stack,
                        const PerFrame<std::optional<Finding>>& suspect_lenses,
                        const CalibrateOptions& options);

}  // namespace volalign

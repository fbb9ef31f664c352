#pragma once

#include "core/base/stage_clock.h"
#include "infer/calib/calibrate.h"
#include "infer/checks/placement.h"
#include "infer/lens/find_lenses.h"
#include "infer/view/frames.h"
#include "infer/view/segmenter.h"

namespace volalign {

/// Looks at captures through their lenses: depth findings, labels and initial poses. `capture` must
/// outlive the result; `segmenter` may be null. Adds times to `clock`. Throws ConfigError for a
/// choice (orientation.choose) that a sensor does not have.
Seen Look(const CaptureSet& input, FoundLenses found, Segmenter* segmenter,
          const CalibrateOptions& options, StageClock* clock);

}  // namespace volalign

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

/// The same through other lenses; labels and poses stay.
Seen WithLenses(Seen seen, LensSet lenses, int threads);

/// Labels and initial poses for the present rays of `seen`. `results`: from the rays before. A
/// located frame is posed near its last pose. Every other frame with valid depths is labelled as if
/// nothing were known of it.
PerFrame<Labelled> LabelAgain(const Seen& seen, const PerFrame<LocateResult>& results,
                              Segmenter* segmenter, const CalibrateOptions& options,
                              StageClock* clock);

}  // namespace volalign

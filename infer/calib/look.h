#pragma once

#include "core/base/stage_clock.h"
#include "infer/calib/calibrate.h"
#include "infer/checks/placement.h"
#include "infer/lens/find_lenses.h"
#include "infer/view/frames.h"
#include "infer/view/segmenter.h"

namespace volalign {

/// Looks at a capture, which has to outlive the result, through its lenses: what depths say by
/// themselves, labels and initial poses. `segmenter` may be null. Adds to `clock` what takes time.
Seen Look(const CaptureSet& capture, FoundLenses found, Segmenter* segmenter,
          const CalibrateOptions& options, StageClock* clock);

/// The same with the rays that frames have through other lenses; labels and poses stay.
Seen WithLenses(Seen seen, LensSet lenses, int threads);

/// Labels and initial poses for the rays that `seen` has now, `results` being what was located with
/// those before: of a located frame, near where it was; every other one is labelled anew, as if
/// nothing were known of it.
PerFrame<Labelled> LabelAgain(const Seen& seen, const PerFrame<LocateResult>& results,
                              Segmenter* segmenter, const CalibrateOptions& options,
                              StageClock* clock);

}  // namespace volalign

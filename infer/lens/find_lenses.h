#pragma once

#include "infer/lens/sensor_lens.h"
#include "infer/lens/straightness.h"
#include "infer/view/frames.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Lenses, and the views through them.
struct FoundLenses {
  LensSet lenses;
  PerFrame<SensorView> views;
};

/// Looks for the change of each lens that makes the large planes of its frames flat, and takes it
/// where that is much more probable than the lens that is assumed. One of which nothing is known
/// may also be like those of a known kind: which is assumed then is what makes the planes most
/// probable. A lens of which something is known, but which the planes contradict altogether, stays
/// as it is. The result has the planes' evidence about every lens, but about such a one.
FoundLenses FindLenses(const CaptureSet& capture, LensSet lenses, int threads);

/// The large planes of each view, which was made with the lenses' intrinsics; none of a frame that
/// repeats a sensor.
PerFrame<SensorPlanes> FindPlanes(const PerFrame<SensorView>& views, const LensSet& lenses,
                                  int threads);

/// The lenses with the evidence of the planes of `views` at their changes.
LensSet MeasureLenses(const PerFrame<SensorView>& views, LensSet lenses, int threads);

}  // namespace volalign

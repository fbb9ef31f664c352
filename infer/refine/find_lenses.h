#pragma once

#include <vector>

#include "infer/refine/straightness.h"
#include "infer/view/sensor_frame.h"
#include "infer/view/sensor_lens.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The frames with the intrinsics of `lenses`.
std::vector<SensorFrame> SeenThrough(std::vector<SensorFrame> frames, const LensSet& lenses);

/// Looks for the change of each lens that makes the large planes of its frames flat, and takes it
/// where that is much more probable than the lens that is assumed. One of which nothing is known
/// may also be like those of a known kind: which is assumed then is what makes the planes most
/// probable. A lens of which something is known, but which the planes contradict altogether, stays
/// as it is. The result has the planes' evidence about every lens, but about such a one.
LensSet FindLenses(const std::vector<SensorFrame>& frames, LensSet lenses, int threads);

/// The large planes of each view, which was made with the lenses' intrinsics; none of a frame that
/// repeats a sensor.
std::vector<SensorPlanes> FindPlanes(const std::vector<SensorView>& views, const LensSet& lenses,
                                     int threads);

/// The planes' evidence at the lenses' changes.
void MeasureLenses(const std::vector<SensorPlanes>& planes, int threads, LensSet* lenses);

}  // namespace volalign

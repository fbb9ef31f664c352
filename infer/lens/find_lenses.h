#pragma once

#include "infer/lens/sensor_lens.h"
#include "infer/lens/straightness.h"
#include "infer/view/frames.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Lenses, and each frame's view through its own.
struct FoundLenses {
  LensSet lenses;
  PerFrame<SensorView> views;
};

/// Looks for the change of each lens that makes the large planes of its frames flat. Takes it if it
/// is much more probable than the assumed lens. A lens of which nothing is known may also be like
/// that of a known kind: the one that makes the planes most probable is assumed. If something is
/// known of a lens, and the planes contradict it altogether, the lens stays as it is. The result
/// has the planes' evidence about every other lens.
FoundLenses FindLenses(const CaptureSet& input, LensSet lenses, int threads);

/// The large planes of each view, which was made with the lenses' intrinsics. Frames that repeat a
/// sensor have none.
PerFrame<SensorPlanes> FindPlanes(const PerFrame<SensorView>& views, const LensSet& lenses,
                                  int threads);

}  // namespace volalign

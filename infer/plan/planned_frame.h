#pragma once

// What a sensor of a planned rig will measure, as far as that can be said without a picture of the
// room: the stack and the floor.

#include <cstdint>
#include <string>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// By how much a kind of sensor's depths are off: standard deviations as polynomials in the depth.
struct DepthErrors {
  double white[3];        ///< of each pixel, m: [0] + [1] z + [2] z^2
  double smooth[3];       ///< of the error that neighbours share
  double correlation_px;  ///< of that, in a picture 320 px wide
  double offset_m;        ///< of the whole picture
  int gap_px;             ///< pixels that are lost at a depth edge, in a picture 320 px wide
};

/// Of a kind, a name of the intrinsics pool: those of time of flight where that is how it is known
/// to measure (infer/lens/sensor_kind.h), of stereo for all others. The middle of the ranges from
/// which the renderer draws (docs/sensor-models.md).
DepthErrors DepthErrorsOf(const std::string& sensor);

struct PlannedFrame {
  SensorFrame frame;
  LabelImage labels;  ///< of what it sees
};

/// The stack as described, on its floor, seen with errors that are drawn from `seed`.
/// `frame` has name, kind, intrinsics and pose (ground_truth).
PlannedFrame MeasurePlanned(SensorFrame frame, const Structure& structure, std::uint64_t seed,
                            std::uint64_t index);

}  // namespace volalign

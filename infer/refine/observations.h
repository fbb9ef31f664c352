#pragma once

// From points to observations. Not for callers of Refine.

#include <vector>

#include "core/geometry/structure.h"
#include "infer/refine/frame_observations.h"
#include "infer/refine/parameters.h"
#include "infer/refine/sensor_points.h"

namespace volalign::refine_internal {

/// Gathers a frame's points on the structure into one observation per image block and side (or
/// edge). `nominal`: the structure as described; `state` has it as built. Replaces observed->faces
/// and ->edges and keeps its noise model.
void GatherObservations(const Structure& nominal, const State& state, std::size_t frame,
                        const SensorPoints& points, FrameObservations* observed);

/// Widens the variances of observations that lie much farther off than the sensor's others. A
/// robust fit of this sensor alone shows them.
void WidenOutliers(const BuildModel& model, const FrameParameters& parameters, const Priors& priors,
                   FrameObservations* observed);

}  // namespace volalign::refine_internal

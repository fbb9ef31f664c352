#pragma once

// From points to observations: what a sensor's points say together, and how far it can be trusted.
// Not for callers of Refine.

#include <vector>

#include "core/geometry/structure.h"
#include "infer/refine/association.h"
#include "infer/refine/frame_observations.h"
#include "infer/refine/parameters.h"
#include "infer/refine/sensor_points.h"

namespace volalign::refine_internal {

/// Gathers a frame's points that lie on the structure into one observation for each image block and
/// side (or edge). `nominal`: the structure as described, `state` has it as built. Replaces
/// observed->faces and ->edges, leaves its noise model.
void GatherObservations(const Structure& nominal, const State& state, std::size_t frame,
                        const SensorPoints& points, const Gates& gates,
                        FrameObservations* observed);

/// Widens the variances of observations that lie much farther off than the sensor's others, after a
/// robust fit of this sensor alone.
void WidenOutliers(const BuildModel& model, const FrameParameters& parameters, const Priors& priors,
                   FrameObservations* observed);

}  // namespace volalign::refine_internal

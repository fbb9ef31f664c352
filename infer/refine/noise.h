#pragma once

// The noise model of a sensor's observations. Not for callers of Refine.

#include <string>

#include "core/geometry/pose.h"
#include "infer/refine/build_model.h"
#include "infer/refine/frame_observations.h"
#include "infer/refine/parameters.h"

namespace volalign::refine_internal {

/// The expected noise of a kind of sensor (a name of the intrinsics pool, see SensorFrame::sensor).
/// It serves before residuals are fitted, and where they are too few.
NoiseModel UsualNoise(const std::string& sensor);

/// Fills the Cholesky factors from observed.noise, with NaN where the covariance has none. `pose`:
/// the sensor's pose.
void SetCovariance(const BuildModel& model, const Pose& pose, FrameObservations* observed);

/// Fits the noise model under which the residuals are most probable, by restricted maximum
/// likelihood (see RestrictedCost). The pose is unknown; all else is as its prior has it. `usual`:
/// the middle of the noise's prior, by the sensor's kind. Too few observations leave the model as
/// it is. Fills the factors too.
void FitNoise(const BuildModel& model, const DepthErrorModel& usual,
              const FrameParameters& parameters, const Priors& priors, FrameObservations* observed);

}  // namespace volalign::refine_internal

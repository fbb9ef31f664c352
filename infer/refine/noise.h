#pragma once

// The noise model of a sensor's observations. Not for callers of Refine.

#include <string>

#include "core/geometry/pose.h"
#include "infer/refine/build_model.h"
#include "infer/refine/frame_observations.h"
#include "infer/refine/parameters.h"

namespace volalign::refine_internal {

/// What is expected of a kind of sensor (a name of the intrinsics pool, see SensorFrame::sensor)
/// before its residuals are fitted, and stands where they are too few to tell.
NoiseModel UsualNoise(const std::string& sensor);

/// Fills the Cholesky factors from observed.noise, with NaN where the covariance has none. `pose`:
/// where the observations are seen from.
void SetCovariance(const BuildModel& model, const Pose& pose, FrameObservations* observed);

/// The noise model under which the residuals are most probable, the pose being unknown (restricted
/// maximum likelihood: Patterson and Thompson, "Recovery of inter-block information when block
/// sizes are unequal", Biometrika 1971) and the rest as its prior has it. `usual`: of the kind, the
/// prior's middle. Too few observations leave it as it is. Fills the factors too.
void FitNoise(const BuildModel& model, const DepthErrorModel& usual,
              const FrameParameters& parameters, const Priors& priors, FrameObservations* observed);

}  // namespace volalign::refine_internal

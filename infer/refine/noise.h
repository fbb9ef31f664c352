#pragma once

// The noise model of a sensor's observations. Not for callers of Refine.

#include "core/pose.h"
#include "infer/refine/build_model.h"
#include "infer/refine/evidence.h"
#include "infer/refine/parameters.h"

namespace volalign::refine_internal {

/// Fills the Cholesky factors from evidence.noise, with NaN where the covariance has none. `pose`:
/// where the observations are seen from.
void SetCovariance(const BuildModel& model, const Pose& pose, SensorEvidence* evidence);

/// The noise model under which the residuals are most probable, the pose being unknown (restricted
/// maximum likelihood: Patterson and Thompson, "Recovery of inter-block information when block
/// sizes are unequal", Biometrika 1971) and the rest as its prior has it. Fills the factors too.
void FitNoise(const BuildModel& model, const SensorParameters& parameters, const Priors& priors,
              SensorEvidence* evidence);

}  // namespace volalign::refine_internal

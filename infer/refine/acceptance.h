#pragma once

// Which sensors' refined poses are better than those that they have to beat. Not for callers of
// Refine.

#include <vector>

#include "infer/refine/estimates.h"
#include "infer/refine/evidence.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// How a pose explains the points that no solution has seen, whatever the sensor's own depth
/// errors are. Distances alone would favour poses that follow the sensor's warp, the misfit alone
/// trusts the noise model.
struct HeldOutFit {
  double misfit = 0;    ///< mean square in standard deviations, as errors are correlated
  double distance = 0;  ///< m, mean absolute distance, depth errors as estimated taken out
};

/// Of a sensor with structure terms at `pose`. `held_out` has its covariance set.
HeldOutFit FitToStructure(const BuildModel& model, const Priors& priors, const State& state,
                          std::size_t sensor, const Pose& pose, const SensorEvidence& held_out);

/// Mean robust cost of one sensor's held-out points, it being at `pose`, against what the others
/// see.
double FitToNeighbours(const JointProblem& problem, const State& state, std::size_t sensor,
                       const Pose& pose);

/// Is a refined pose to be taken? Either measure tells.
inline bool Better(const HeldOutFit& after, const HeldOutFit& before) {
  return after.misfit < before.misfit || after.distance < before.distance;
}

/// Held-out observations that lie on the structure from either pose of a sensor, refined or to
/// be beaten, trusted as `solution` trusts its own.
std::vector<SensorEvidence> GatherHeldOut(const JointProblem& problem, const Solution& solution);

struct Acceptance {
  Solution solution;  ///< in which sensors that were not accepted stand where they began
  std::vector<char> kept_initial;  ///< of each sensor: not accepted
  std::vector<HeldOutFit> before, after;
  std::vector<Vector6d> refused;  ///< from the fallback to the refused pose, m and rad; or zero
};

/// Sends sensors back whose held-out points their refined pose explains no better than the one
/// to beat. A sensor that goes back may have pulled its neighbours: they are solved again around
/// it.
Acceptance AcceptImproved(const JointProblem& problem, Solution solution);

}  // namespace volalign::refine_internal

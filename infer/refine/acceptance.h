#pragma once

// Which sensors' refined poses are better than those that they have to beat. Not for callers of
// Refine.

#include <cmath>
#include <vector>

#include "infer/refine/estimates.h"
#include "infer/refine/frame_observations.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// How a pose explains observations, whatever the sensor's own depth errors are. Distances alone
/// would favour poses that follow the sensor's warp, the misfit alone trusts the noise model.
struct PoseFit {
  double misfit = 0;     ///< mean square in standard deviations, as errors are correlated
  double distance = 0;   ///< m, mean absolute distance, depth errors as estimated taken out
  int observations = 0;  ///< that it was judged by
};

/// Of a sensor at `pose`. `observed` has its covariance set.
PoseFit FitToStructure(const BuildModel& model, const Priors& priors, const State& state,
                       std::size_t sensor, const Pose& pose, const FrameObservations& observed);

/// Is a refined pose to be taken, by points that no solution has seen? They are few, so that by
/// chance a better pose may seem worse: it is refused where it lies farther off and is less
/// probable by more than kModelOdds.
inline bool IsBetter(const PoseFit& after, const PoseFit& before) {
  if (after.observations == 0 || before.observations == 0) return after.observations > 0;
  const double rise = after.observations * (after.misfit - before.misfit);
  return rise < 2 * std::log(kModelOdds) || after.distance < before.distance;
}

/// Is it to be taken where nothing was held out, by the points that it was fitted to? They favour
/// it, so that it has to be worse by both measures to be refused. Where there are none at all,
/// nothing speaks for it.
inline bool IsNoWorse(const PoseFit& after, const PoseFit& before) {
  if (after.observations == 0 || before.observations == 0) return after.observations > 0;
  return after.misfit <= before.misfit || after.distance <= before.distance;
}

/// Observations for BlockUse::kAccept that lie on the structure from either pose of a sensor,
/// refined or to be beaten, trusted as `solution` trusts its own.
std::vector<FrameObservations> GatherHeldOut(const JointProblem& problem, const Solution& solution);

struct Acceptance {
  Solution solution;  ///< in which sensors that were not accepted are kept at their fallbacks
  std::vector<Vector6d> refused;  ///< from the fallback to the refused pose, m and rad; or zero
};

/// Sends sensors back whose refined pose is not better than the one to beat, by their points for
/// BlockUse::kAccept (IsBetter) or, for want of any, by their own (IsNoWorse). A sensor that goes
/// back may have pulled its neighbours: they are solved again without it.
Acceptance AcceptImproved(const JointProblem& problem, Solution solution);

}  // namespace volalign::refine_internal

#pragma once

// What is estimated beside the poses: what the capture tells. Not for callers of Refine.

#include <vector>

#include "infer/refine/evidence.h"
#include "infer/refine/fine.h"
#include "infer/refine/posterior.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// Of `free`, those parameters that the capture tells clearly more about than their priors do; and
/// those lenses whose change (`lenses`) is much more probable than none.
/// `constant`: columns that were never asked for, see ComputePosterior.
FreeSet Observable(const NormalEquations& normal, const ParameterLayout& layout,
                   const Structure& structure, const Priors& priors,
                   const std::vector<LensChange>& lenses, const std::vector<char>& constant,
                   const Eigen::VectorXd& prior_sigmas, const FreeSet& free);

/// Each sensor's observations for BlockUse::kChoose, as they lie at `state`.
std::vector<SensorEvidence> GatherUnseen(const JointProblem& problem, const State& state);

/// Mean robust cost of observations that no solution sees, under the whole model.
double UnseenCost(const JointProblem& problem, const State& state,
                  const std::vector<SensorEvidence>& unseen);

/// Keeps those parameters that the capture tells clearly more about than their priors do, of
/// kinds (boxes, size, gain, offset, lens) without which the observations of GatherUnseen do not
/// fit as well. The others are nominal in the solution that is returned. `solution.free` is what
/// was asked for.
Solution ChooseEstimates(const JointProblem& problem, Solution solution);

}  // namespace volalign::refine_internal

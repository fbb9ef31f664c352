#pragma once

// What is estimated beside the poses: what the capture tells. Not for callers of Refine.

#include <vector>

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

/// Keeps those parameters that the capture tells clearly more about than their priors do, of the
/// kinds (boxes, size, gain, offset) that stray from their nominal values according to
/// MostProbableScales; or those of RefineSetup::choice. The others are nominal in the solution that
/// is returned. `solution.free` is what was asked for.
Solution ChooseEstimates(const JointProblem& problem, Solution solution);

}  // namespace volalign::refine_internal

#pragma once

// Runs Ceres. Not for callers of Refine.

#include <ceres/problem.h>

#include "infer/refine/options.h"

namespace volalign::refine_internal {

/// How a solution ended.
struct Minimum {
  bool usable = false;     ///< false: the cost cannot be evaluated or no step can be computed
  bool converged = false;  ///< by its tolerances, not by the number of steps
};

/// Moves the parameters to the least cost within inner_iterations steps. They stay as they
/// are if that is not usable.
Minimum Minimise(const RefineOptions& options, ceres::Problem* problem);

}  // namespace volalign::refine_internal

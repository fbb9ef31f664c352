#pragma once

// A Ceres problem with everything that it refers to. Not for callers of Refine.

#include <ceres/manifold.h>
#include <ceres/problem.h>

#include <memory>
#include <vector>

#include "infer/refine/options.h"
#include "infer/refine/pose_manifold.h"

namespace volalign::refine_internal {

struct CeresProblem {
  CeresProblem();

  std::unique_ptr<LeftPoseManifold> manifold;  ///< of poses
  std::vector<std::unique_ptr<ceres::Manifold>> subsets;
  std::unique_ptr<ceres::Problem> problem;  ///< last: it refers to the others

  /// Makes these elements of a block constant. The block is not a pose.
  void HoldConstant(double* block, int size, const std::vector<int>& elements);
};

/// How a solution ended.
struct Minimum {
  bool usable = false;     ///< false: the cost cannot be evaluated or no step can be computed
  bool converged = false;  ///< by its tolerances, not by the number of steps
};

/// Moves the parameters to the least cost within the schedule's number of steps. They stay as they
/// are if that is not usable.
Minimum Minimise(const RefineSchedule& schedule, ceres::Problem* problem);

}  // namespace volalign::refine_internal

#pragma once

// A Ceres problem with what it refers to. Not for callers of Refine.

#include <ceres/loss_function.h>
#include <ceres/manifold.h>
#include <ceres/problem.h>

#include <memory>
#include <vector>

#include "infer/refine/options.h"
#include "infer/refine/pose_manifold.h"

namespace volalign::refine_internal {

struct CeresProblem {
  CeresProblem();

  std::unique_ptr<ceres::LossFunction> loss;   ///< of terms over single points
  std::unique_ptr<LeftPoseManifold> manifold;  ///< of poses
  std::vector<std::unique_ptr<ceres::Manifold>> subsets;
  std::unique_ptr<ceres::Problem> problem;  ///< last: it refers to the others

  /// Holds those elements of a block that are not a pose constant.
  void HoldConstant(double* block, int size, const std::vector<int>& elements);
};

/// Moves the parameters to the least cost that the options' number of steps reaches. Returns false,
/// and leaves them where they are, if the cost cannot be evaluated or no step can be computed.
bool Minimise(const RefineOptions& options, ceres::Problem* problem);

}  // namespace volalign::refine_internal

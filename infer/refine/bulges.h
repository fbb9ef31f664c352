#pragma once

// Sides that are not flat. Not for callers of Refine.

#include <Eigen/Core>

#include "infer/refine/problem.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// By how much a frame's faces (a row each, m) are off where the side of a label (a column) bulges
/// by one standard deviation (Side::BulgeAt, PriorOptions::bulge_sigma_m): residuals shrink by
/// that.
Eigen::MatrixXd BulgesOfFaces(const JointProblem& problem, const Solution& solution,
                              std::size_t frame);

/// NormalEquations::pulls of these, a column for each label: a bulge is the same for all frames
/// that see the side.
Eigen::MatrixXd PullsOfBulges(const JointProblem& problem, const Solution& solution);

}  // namespace volalign::refine_internal

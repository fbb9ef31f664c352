#pragma once

// The refinement's terms as a problem for Ceres. Not for callers of Refine.

#include <ceres/problem.h>

#include <Eigen/Core>
#include <vector>

#include "infer/refine/frame_observations.h"
#include "infer/refine/pair_overlap.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// Prior standard deviations of all parameters as in the options, under the noise models of
/// `observed`.
Eigen::VectorXd PriorSigmas(const JointProblem& problem,
                            const std::vector<FrameObservations>& observed);

/// The problem over all parameters; it refers to all its arguments. Parameters marked in `constant`
/// (see ParameterLayout::Constant) do not change. A frame whose pose is constant has no structure
/// terms. Fixed frames are not tied to others of their sensor.
ceres::Problem BuildCeresProblem(const JointProblem& problem,
                                 const std::vector<FrameObservations>& observed,
                                 const std::vector<PairOverlap>& overlaps,
                                 const std::vector<char>& fixed, const std::vector<char>& constant,
                                 State* state);

}  // namespace volalign::refine_internal

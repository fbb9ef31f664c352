#pragma once

// How well the parameters are known. Columns are those of ParameterLayout. Not for callers of
// Refine.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "infer/refine/problem.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// Of a least-squares cost, in tangent spaces.
struct NormalEquations {
  Eigen::MatrixXd information;  ///< J^T J
  Eigen::VectorXd gradient;     ///< J^T r
  bool evaluated = true;        ///< false: they are those of the priors alone
};

/// Of the refinement's cost at a solution, with everything free. Where the cost cannot be
/// evaluated, of the priors alone. Each of `changed`, a structure with the same sides, adds a
/// column, last: by what share the real structure is that one rather than the described one. These
/// have no priors.
NormalEquations ComputeNormalEquations(const JointProblem& problem, const Solution& solution,
                                       const std::vector<Structure>& changed = {});

struct Posterior {
  Eigen::MatrixXd covariance;
  /// False: the normal equations had no inverse. The covariance is that of what they tell beyond
  /// the priors, which stand in for the rest.
  bool exact = true;

  double Sigma(Eigen::Index column) const {
    return std::sqrt(std::max(covariance(column, column), 0.0));
  }
};

/// Covariance with everything free. Where something was not asked for (`constant`), widened by the
/// square of the step that everything would take from here if it were free.
/// `prior_sigmas`: of all parameters. The covariance is finite, whatever the normal equations are.
Posterior ComputePosterior(const NormalEquations& normal, const std::vector<char>& constant,
                           const Eigen::VectorXd& prior_sigmas);

/// Covariance where the constant parameters are known.
Posterior ConditionalPosterior(const NormalEquations& normal, const std::vector<char>& constant,
                               const Eigen::VectorXd& prior_sigmas);

/// Projection of box displacements (x, z, yaw of each) along the gauge, in which all boxes move
/// as one, to those that the prior finds likeliest. 3 x boxes square.
Eigen::MatrixXd GaugeProjection(const Structure& structure, const Priors& priors);

/// Posterior standard deviations of the boxes' x, z (m) and yaw (rad) in one still, the gauge taken
/// out.
Eigen::VectorXd BoxSigmas(const Posterior& posterior, const ParameterLayout& layout,
                          std::size_t still, const Eigen::MatrixXd& gauge_projection);

}  // namespace volalign::refine_internal

#pragma once

// Uncertainty of the parameters. Columns are those of ParameterLayout. Not for callers of Refine.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "infer/refine/problem.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// The normal equations of a least-squares cost, in tangent spaces.
struct NormalEquations {
  Eigen::MatrixXd information;  ///< J^T J
  Eigen::VectorXd gradient;     ///< J^T r
  bool evaluated = true;        ///< false: they are those of the priors alone
};

/// The normal equations of the refinement's cost at a solution, with everything free. They are
/// those of the priors alone if the cost cannot be evaluated. Each of `changed`, a structure with
/// the same sides, adds a column at the end. It is the share by which the real structure is that
/// one instead of the described one, and has no prior.
NormalEquations ComputeNormalEquations(const JointProblem& problem, const Solution& solution,
                                       const std::vector<Structure>& changed = {});

/// The normal equations of the parameters `kept`, with `others` at their most probable values.
/// Nothing if the others have none.
std::optional<NormalEquations> Marginal(const NormalEquations& normal,
                                        const std::vector<Eigen::Index>& kept,
                                        const std::vector<Eigen::Index>& others);

struct Posterior {
  Eigen::MatrixXd covariance;
  /// False: the normal equations had no inverse. The covariance then covers only what they
  /// determine beyond the priors. The priors stand in for the rest.
  bool exact = true;

  double Sigma(Eigen::Index column) const {
    return std::sqrt(std::max(covariance(column, column), 0.0));
  }
};

/// Covariance with everything free. If something is `constant`, it is widened by the square of the
/// step that all parameters would take from here if free. `prior_sigmas`: of all parameters. The
/// covariance is finite for any normal equations.
Posterior ComputePosterior(const NormalEquations& normal, const std::vector<char>& constant,
                           const Eigen::VectorXd& prior_sigmas);

/// Covariance where the constant parameters are known.
Posterior ConditionalPosterior(const NormalEquations& normal, const std::vector<char>& constant,
                               const Eigen::VectorXd& prior_sigmas);

/// Projects box displacements (x, z, yaw of each) along the gauge, in which all boxes move as one,
/// to those that the prior finds likeliest. 3 x boxes square.
Eigen::MatrixXd GaugeProjection(const Structure& structure, const Priors& priors);

/// Posterior standard deviations of the boxes' x, z (m) and yaw (rad) in one capture, without the
/// gauge.
Eigen::VectorXd BoxSigmas(const Posterior& posterior, const ParameterLayout& layout,
                          std::size_t capture, const Eigen::MatrixXd& gauge_projection);

}  // namespace volalign::refine_internal

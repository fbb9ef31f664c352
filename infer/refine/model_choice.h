#pragma once

// How far what is estimated beside the poses really strays from its nominal value: as far as its
// prior says, less, or not at all. Not for callers of Refine.

#include <Eigen/Core>
#include <array>
#include <vector>

#include "infer/refine/parameters.h"
#include "infer/refine/posterior.h"

namespace volalign::refine_internal {

/// The cost around a solution, as a quadratic function of all parameters, priors included.
struct QuadraticCost {
  Eigen::MatrixXd information;   ///< J^T J
  Eigen::VectorXd gradient;      ///< J^T r
  Eigen::VectorXd values;        ///< of the parameters, as they differ from their priors' means
  Eigen::VectorXd prior_sigmas;  ///< of the priors that are part of it
};

/// What follows when each parameter's prior is narrowed by a factor.
struct ModelFit {
  double log_evidence = 0;  ///< of the measurements, by Laplace's approximation, up to a constant
  Eigen::VectorXd step;     ///< from the solution to the most probable values
  Eigen::MatrixXd covariance;
};
/// `scales`: of the priors' standard deviations, one a parameter; 0: held at the prior's mean.
/// `with_covariance`: else it is left empty. The log evidence is -infinity where there is no
/// Cholesky factor.
ModelFit FitModel(const QuadraticCost& cost, const Eigen::VectorXd& scales, bool with_covariance);

/// All combinations of scales, each kind's 0, some in between, or 1.
std::vector<PriorScales> AllScales();

/// The scales under which the measurements are most probable, of those kinds of which `free` has
/// any parameter; the others' are 1.
PriorScales MostProbableScales(const QuadraticCost& cost, const ParameterLayout& layout,
                               const FreeSet& free);

/// Covariance of the parameters around the solution, whatever their scales are: the mean over all
/// combinations, weighted by their evidence. Empty where it cannot be computed.
Eigen::MatrixXd CovarianceOverModels(const QuadraticCost& cost, const ParameterLayout& layout);

}  // namespace volalign::refine_internal

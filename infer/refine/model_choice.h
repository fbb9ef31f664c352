#pragma once

// How far what is estimated beside the poses really strays from its nominal value: as far as its
// prior says, less, or not at all. Not for callers of Refine.

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "infer/refine/parameters.h"
#include "infer/refine/posterior.h"
#include "infer/refine/problem.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

/// The refinement's cost around a solution, as a quadratic function of all parameters.
struct QuadraticCost {
  NormalEquations normal;        ///< priors included, as the options have them
  Eigen::VectorXd prior_sigmas;  ///< of these priors
  Eigen::VectorXd values;        ///< of all parameters, see ParameterLayout::Values
};
QuadraticCost CostAround(const JointProblem& problem, const Solution& solution);

/// What follows where priors are narrower than the cost has them.
struct ModelFit {
  /// Natural logarithm of the probability of the measurements, all parameters being unknown, by
  /// Laplace's approximation (MacKay, "Information Theory, Inference, and Learning Algorithms",
  /// chapter 28); up to a constant that is the same for all scales.
  double log_evidence = 0;
  Eigen::VectorXd step;        ///< from the solution to the most probable values
  Eigen::MatrixXd covariance;  ///< of all parameters; zero of those that are held
};
/// `scales`: factors on the priors' standard deviations, one per parameter; 0 holds it at its
/// prior's mean. Without `with_covariance` there is none. Nothing where it cannot be computed.
std::optional<ModelFit> FitModel(const QuadraticCost& cost, const Eigen::VectorXd& scales,
                                 bool with_covariance);

/// A cost of some of the parameters, all others being unknown: FitModel's evidence of it differs
/// from that of the cost of all by the same constant for all scales.
struct MarginalCost {
  QuadraticCost cost;
  std::vector<Eigen::Index> columns;  ///< of the parameters that are left
  std::vector<Eigen::Index> free;     ///< of the others
  /// Of the others: their step to their most probable values and their covariance where those that
  /// are left stay, and by how much their step is more for a step of each of these.
  Eigen::VectorXd free_step;
  Eigen::MatrixXd free_covariance, follows;
};
/// Without the parameters whose priors are never narrowed (ParameterLayout::IsAlwaysFree). Nothing
/// where it cannot be computed.
std::optional<MarginalCost> WithoutAlwaysFree(const QuadraticCost& cost,
                                              const ParameterLayout& layout);

/// The scales under which the measurements are most probable, where only `free` may stray. Nothing
/// where that cannot be computed.
std::optional<PriorScales> MostProbableScales(const QuadraticCost& cost,
                                              const ParameterLayout& layout, const FreeSet& free,
                                              int threads);

/// Covariance of the parameters about the solution: the mean over all scales, weighted by their
/// evidence, of the covariance under these scales and of the square of the step to their most
/// probable values. Scales under which it cannot be computed take no part; nothing, or a finite
/// covariance.
std::optional<Eigen::MatrixXd> CovarianceOverModels(const QuadraticCost& cost,
                                                    const ParameterLayout& layout, int threads);

}  // namespace volalign::refine_internal

#pragma once

// How far the parameters beside the poses really deviate from their nominal values: as far as their
// priors say, or less. Not for callers of Refine.

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

/// The same with the priors' standard deviations times `scales`, one per parameter. A scale of 0
/// leaves the prior as it is.
NormalEquations WithScaledPriors(const QuadraticCost& cost, const Eigen::VectorXd& scales);

/// The fit under narrower priors.
struct ModelFit {
  /// Natural logarithm of the probability of the measurements with all parameters unknown, up to a
  /// constant that is the same for all scales. By Laplace's approximation (MacKay, "Information
  /// Theory, Inference, and Learning Algorithms", chapter 28).
  double log_evidence = 0;
  Eigen::VectorXd step;        ///< from the solution to the most probable values
  Eigen::MatrixXd covariance;  ///< of all parameters; zero of fixed ones
};
/// `scales`: factors on the priors' standard deviations, one per parameter. 0 fixes the parameter
/// at its prior's mean. The covariance is computed only if `with_covariance`. Nothing if it cannot
/// be computed.
std::optional<ModelFit> FitModel(const QuadraticCost& cost, const Eigen::VectorXd& scales,
                                 bool with_covariance);

/// The scales under which the measurements are most probable, by expectation maximisation. Only
/// `free` may deviate. The square of a scale is the mean over its group of a parameter's expected
/// square in units of its prior. At least 0.02 and at most 1. Nothing if they cannot be computed.
std::optional<PriorScales> EstimatePriorScales(const QuadraticCost& cost,
                                               const ParameterLayout& layout, const FreeSet& free);

/// Widens each group's scale, as if one more parameter of the group had deviated as far as its
/// prior says. A scale is estimated from few parameters; covariances allow for that.
PriorScales WidenedScales(const Eigen::VectorXd& prior_sigmas, const ParameterLayout& layout,
                          const FreeSet& free, const PriorScales& scales);

/// Estimates the scales and solves again under them. A lens keeps its assumed value unless its
/// change is much more probable (kBelievedLens). Returns the solution unchanged if scales cannot be
/// computed.
Solution SolveWithScaledPriors(const JointProblem& problem, Solution solution);

}  // namespace volalign::refine_internal

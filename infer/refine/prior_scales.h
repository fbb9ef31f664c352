#pragma once

// How far what is estimated beside the poses really strays from its nominal value: as far as its
// prior says, or less. Not for callers of Refine.

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

/// The same with the priors' standard deviations times `scales`, one per parameter; where that is
/// 0, with its prior as it is.
NormalEquations WithScaledPriors(const QuadraticCost& cost, const Eigen::VectorXd& scales);

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

/// A cost of some of the parameters, all others being at their best: its fits are those of the cost
/// of all parameters, and its evidence differs by the same constant for all scales.
struct MarginalCost {
  QuadraticCost cost;
  std::vector<Eigen::Index> columns;  ///< of the parameters that are left
};
/// Without the parameters whose priors are never narrowed (ParameterLayout::IsAlwaysFree). Nothing
/// where it cannot be computed.
std::optional<MarginalCost> WithoutAlwaysFree(const QuadraticCost& cost,
                                              const ParameterLayout& layout);

/// The scales under which the measurements are most probable, where only `free` may stray, by
/// expectation maximisation: the square of a scale is the mean, over its group, of the expected
/// square of a parameter in units of its prior. At least 0.02 and at most 1. Nothing where they
/// cannot be computed.
std::optional<PriorScales> EstimatePriorScales(const QuadraticCost& cost,
                                               const ParameterLayout& layout, const FreeSet& free);

/// How far each group may stray: as if one parameter more of each had been seen to stray as far as
/// its prior says. A scale is estimated from few parameters; covariances allow for that.
PriorScales WidenedScales(const ParameterLayout& layout, const FreeSet& free,
                          const PriorScales& scales);

/// Estimates the scales and solves again under them. A lens whose change is not much more probable
/// than none (kBelievedLens) is as assumed. The solution as it is where scales cannot be computed.
Solution SolveWithScaledPriors(const JointProblem& problem, Solution solution);

}  // namespace volalign::refine_internal

#pragma once

// How well the parameters are known. Columns are those of ParameterLayout. Not for callers of
// Refine.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "infer/refine/evidence.h"
#include "infer/refine/problem.h"

namespace volalign::refine_internal {

/// Of a least-squares cost, in tangent spaces.
struct NormalEquations {
  Eigen::MatrixXd information;  ///< J^T J
  Eigen::VectorXd gradient;     ///< J^T r
};

/// Of the fine stage's cost at `state`, with everything free.
NormalEquations ComputeNormalEquations(const JointProblem& problem,
                                       const std::vector<SensorEvidence>& evidence,
                                       const std::vector<char>& kept_initial, State state);

struct Posterior {
  Eigen::MatrixXd covariance;

  double Sigma(Eigen::Index column) const {
    return std::sqrt(std::max(covariance(column, column), 0.0));
  }
};

/// Covariance with everything free. Where something was not asked for (`constant`), widened by the
/// square of the step that everything would take from here if it were free; and for a shift of
/// silhouettes that all sensors have in common, which looks like another size. `edge_shift`, px:
/// prior standard deviation of a sensor's own.
Posterior ComputePosterior(const NormalEquations& normal, const ParameterLayout& layout,
                           const std::vector<char>& constant, double edge_shift);

/// Covariance where the constant parameters are known.
Posterior ConditionalPosterior(const NormalEquations& normal, const std::vector<char>& constant);

/// Projection of box displacements (x, z, yaw of each) along the gauge, in which all boxes move
/// as one, to those that the prior finds likeliest. 3 x boxes square.
Eigen::MatrixXd GaugeProjection(const Structure& structure, const Priors& priors);

/// Posterior standard deviations of the boxes' x, z (m) and yaw (rad), the gauge taken out.
Eigen::VectorXd BoxSigmas(const Posterior& posterior, const ParameterLayout& layout,
                          const Eigen::MatrixXd& gauge_projection);

}  // namespace volalign::refine_internal

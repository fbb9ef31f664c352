#include "infer/lens/likelihood.h"

#include <limits>

#include "core/geometry/factor.h"

namespace volalign::refine_internal {

double RestrictedCost(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& r,
                      const Eigen::MatrixXd& jacobian) {
  const std::optional<CholeskyFactor> root = Factor(covariance);
  if (!root) return std::numeric_limits<double>::infinity();
  const Eigen::VectorXd y = root->matrixL().solve(r);
  const Eigen::MatrixXd a = root->matrixL().solve(jacobian);
  Eigen::MatrixXd information = a.transpose() * a;
  information.diagonal().array() += 1e-3 * (1 + information.diagonal().maxCoeff() * 1e-9);
  const std::optional<CholeskyFactor> inner = Factor(information);
  if (!inner) return std::numeric_limits<double>::infinity();
  const Eigen::VectorXd projected = inner->matrixL().solve(a.transpose() * y);
  return LogRoot(*root) + LogRoot(*inner) + 0.5 * (y.squaredNorm() - projected.squaredNorm());
}

}  // namespace volalign::refine_internal

#include "infer/refine/likelihood.h"

#include <Eigen/Cholesky>
#include <limits>

namespace volalign::refine_internal {

double RestrictedCost(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& r,
                      const Eigen::MatrixXd& jacobian) {
  const Eigen::LLT<Eigen::MatrixXd> root(covariance);
  if (root.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  const Eigen::VectorXd y = root.matrixL().solve(r);
  const Eigen::MatrixXd a = root.matrixL().solve(jacobian);
  Eigen::MatrixXd information = a.transpose() * a;
  information.diagonal().array() += 1e-3 * (1 + information.diagonal().maxCoeff() * 1e-9);
  const Eigen::LLT<Eigen::MatrixXd> inner(information);
  if (inner.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  const Eigen::VectorXd projected = inner.matrixL().solve(a.transpose() * y);
  double log_root = 0, log_inner = 0;
  for (Eigen::Index i = 0; i < covariance.rows(); ++i) log_root += std::log(root.matrixLLT()(i, i));
  for (Eigen::Index i = 0; i < information.rows(); ++i)
    log_inner += std::log(inner.matrixLLT()(i, i));
  return log_root + log_inner + 0.5 * (y.squaredNorm() - projected.squaredNorm());
}

}  // namespace volalign::refine_internal

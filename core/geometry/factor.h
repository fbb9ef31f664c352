#pragma once

// Not for callers of Refine.

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <optional>

namespace volalign::refine_internal {

using CholeskyFactor = Eigen::LLT<Eigen::MatrixXd>;

/// The Cholesky factor of a symmetric matrix. Nothing if the matrix is not finite or not positive
/// definite, so that nobody solves with a failed factor.
inline std::optional<CholeskyFactor> Factor(const Eigen::MatrixXd& symmetric) {
  if (!symmetric.allFinite()) return std::nullopt;
  CholeskyFactor factor(symmetric);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return factor;
}

/// Logarithm of the determinant of the factor's lower triangle: half of the matrix's.
inline double LogRoot(const CholeskyFactor& factor) {
  return factor.matrixLLT().diagonal().array().log().sum();
}

}  // namespace volalign::refine_internal

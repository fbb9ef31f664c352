#include "infer/refine/posterior.h"

#include <ceres/crs_matrix.h>
#include <ceres/problem.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SparseCore>
#include <algorithm>

#include "core/geometry/factor.h"
#include "infer/refine/terms.h"

namespace volalign::refine_internal {

namespace {

/// J^T J, dense.
Eigen::MatrixXd Information(const ceres::CRSMatrix& jacobian) {
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(jacobian.num_cols, jacobian.num_cols);
  const auto first_of = [&](int row) { return jacobian.rows[static_cast<std::size_t>(row)]; };
  for (int row = 0, end; row < jacobian.num_rows; row = end) {
    // The rows of one residual block have the same columns.
    const int count = first_of(row + 1) - first_of(row);
    const int* const columns = jacobian.cols.data() + first_of(row);
    const auto is_alike = [&](int other) {
      return first_of(other + 1) - first_of(other) == count &&
             std::equal(columns, columns + count, jacobian.cols.data() + first_of(other));
    };
    for (end = row + 1; end < jacobian.num_rows && is_alike(end);) ++end;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const Eigen::Map<const RowMajor> block(jacobian.values.data() + first_of(row), end - row,
                                           count);
    const Eigen::MatrixXd squares = block.transpose() * block;
    for (int i = 0; i < count; ++i) {
      for (int j = 0; j < count; ++j) information(columns[i], columns[j]) += squares(i, j);
    }
  }
  return information;
}

/// Inverse of J^T J by Cholesky. If that fails: by its eigenvalues in units of the priors, each at
/// least 1. With priors none is smaller, except by rounding: there the prior counts.
class Inverse {
 public:
  Inverse(const Eigen::MatrixXd& information, const Eigen::VectorXd& prior_sigmas) {
    factor_ = Factor(information);
    if (factor_ && factor_->solve(Eigen::VectorXd::Ones(information.rows())).allFinite()) return;
    factor_.reset();
    Eigen::MatrixXd scaled = prior_sigmas.asDiagonal() * information * prior_sigmas.asDiagonal();
    for (Eigen::Index k = 0; k < scaled.rows(); ++k) {
      if (scaled.row(k).allFinite() && scaled.col(k).allFinite()) continue;
      scaled.row(k).setZero();
      scaled.col(k).setZero();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scaled);
    const Eigen::MatrixXd vectors = prior_sigmas.asDiagonal() * solver.eigenvectors();
    inverse_ = vectors * solver.eigenvalues().cwiseMax(1).cwiseInverse().asDiagonal() *
               vectors.transpose();
    // If even that fails, the priors.
    if (!inverse_.allFinite()) inverse_ = prior_sigmas.cwiseAbs2().asDiagonal();
  }
  bool exact() const { return factor_.has_value(); }
  Eigen::MatrixXd Times(const Eigen::MatrixXd& b) const {
    return factor_ ? Eigen::MatrixXd(factor_->solve(b)) : Eigen::MatrixXd(inverse_ * b);
  }

 private:
  std::optional<CholeskyFactor> factor_;
  Eigen::MatrixXd inverse_;
};

Eigen::VectorXd ToVector(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

}  // namespace

NormalEquations ComputeNormalEquations(const JointProblem& problem, const Solution& solution,
                                       const std::vector<Structure>& changed) {
  State state = solution.state;
  state.scales = PriorScales::Ones();  // the priors as the options have them
  const std::vector<char> none(static_cast<std::size_t>(problem.layout.size()), 0);
  ceres::Problem ceres = BuildCeresProblem(problem, solution.observed, solution.overlaps,
                                           solution.fixed, none, &state);
  ceres::Problem::EvaluateOptions evaluation;
  for (const ParameterLayout::Block& block : problem.layout.Blocks(&state))
    evaluation.parameter_blocks.push_back(block.values);
  evaluation.num_threads = problem.setup.threads;
  ceres::CRSMatrix jacobian;
  std::vector<double> residuals, gradient;
  if (!ceres.Evaluate(evaluation, nullptr, &residuals, &gradient, &jacobian)) {
    const Eigen::VectorXd sigmas = PriorSigmas(problem, solution.observed);
    return {sigmas.cwiseAbs2().cwiseInverse().asDiagonal(), Eigen::VectorXd::Zero(sigmas.size()),
            false};
  }
  const Eigen::VectorXd r = ToVector(residuals);
  Eigen::MatrixXd columns(r.size(), static_cast<Eigen::Index>(changed.size()));
  for (std::size_t k = 0; k < changed.size(); ++k) {
    JointProblem other = problem;
    other.model = BuildModel(changed[k]);
    ceres::Problem of_other = BuildCeresProblem(other, solution.observed, solution.overlaps,
                                                solution.fixed, none, &state);
    if (!of_other.Evaluate(evaluation, nullptr, &residuals, nullptr, nullptr))
      return {Information(jacobian), ToVector(gradient), false};
    columns.col(static_cast<Eigen::Index>(k)) = ToVector(residuals) - r;
  }
  const Eigen::Index known = jacobian.num_cols, all = known + columns.cols();
  NormalEquations normal{Eigen::MatrixXd(all, all), Eigen::VectorXd(all)};
  const Eigen::Map<const Eigen::SparseMatrix<double, Eigen::RowMajor>> sparse(
      jacobian.num_rows, jacobian.num_cols, static_cast<Eigen::Index>(jacobian.values.size()),
      jacobian.rows.data(), jacobian.cols.data(), jacobian.values.data());
  const Eigen::MatrixXd cross = sparse.transpose() * columns;
  normal.information << Information(jacobian), cross, cross.transpose(),
      columns.transpose() * columns;
  normal.gradient << ToVector(gradient), columns.transpose() * r;
  return normal;
}

std::optional<NormalEquations> Marginal(const NormalEquations& normal,
                                        const std::vector<Eigen::Index>& kept,
                                        const std::vector<Eigen::Index>& others) {
  const Eigen::MatrixXd& h = normal.information;
  const Eigen::VectorXd& g = normal.gradient;
  const std::optional<CholeskyFactor> factor = Factor(h(others, others));
  if (!factor) return std::nullopt;
  const Eigen::MatrixXd cross = h(others, kept);
  return NormalEquations{h(kept, kept) - cross.transpose() * factor->solve(cross),
                         g(kept) - cross.transpose() * factor->solve(Eigen::VectorXd(g(others)))};
}

Posterior ComputePosterior(const NormalEquations& normal, const std::vector<char>& constant,
                           const Eigen::VectorXd& prior_sigmas) {
  const Eigen::MatrixXd& h = normal.information;
  const Inverse inverse(h, prior_sigmas);
  Posterior posterior;
  posterior.exact = inverse.exact() && normal.evaluated;
  posterior.covariance = inverse.Times(Eigen::MatrixXd::Identity(h.rows(), h.cols()));
  if (std::any_of(constant.begin(), constant.end(), [](char c) { return c != 0; })) {
    const Eigen::VectorXd step = inverse.Times(normal.gradient);
    if (step.allFinite()) posterior.covariance += step * step.transpose();
  }
  return posterior;
}

Posterior ConditionalPosterior(const NormalEquations& normal, const std::vector<char>& constant,
                               const Eigen::VectorXd& prior_sigmas) {
  Eigen::MatrixXd h = normal.information;
  for (std::size_t i = 0; i < constant.size(); ++i) {
    if (!constant[i]) continue;
    const auto k = static_cast<Eigen::Index>(i);
    h.row(k).setZero();
    h.col(k).setZero();
    h(k, k) = 1;
  }
  const Inverse inverse(h, prior_sigmas);
  return {inverse.Times(Eigen::MatrixXd::Identity(h.rows(), h.cols())), inverse.exact()};
}

Eigen::MatrixXd GaugeProjection(const Structure& structure, const Priors& priors) {
  const auto boxes = static_cast<Eigen::Index>(structure.boxes().size());
  Eigen::MatrixXd gauge = Eigen::MatrixXd::Zero(3 * boxes, 3);
  Eigen::VectorXd precision(3 * boxes);
  for (Eigen::Index b = 0; b < boxes; ++b) {
    const Eigen::Vector3d centre =
        structure.boxes()[static_cast<std::size_t>(b)].structure_from_box.translation();
    gauge(3 * b, 0) = gauge(3 * b + 1, 1) = gauge(3 * b + 2, 2) = 1;
    gauge(3 * b, 2) = centre.z();
    gauge(3 * b + 1, 2) = -centre.x();
    precision[3 * b] = precision[3 * b + 1] = 1 / Square(Positive(priors.box));
    precision[3 * b + 2] = 1 / Square(Positive(priors.yaw));
  }
  const Eigen::MatrixXd weighted = precision.asDiagonal() * gauge;
  const Eigen::Matrix3d inner = gauge.transpose() * weighted;
  return Eigen::MatrixXd::Identity(3 * boxes, 3 * boxes) -
         gauge * inner.inverse() * weighted.transpose();
}

Eigen::VectorXd BoxSigmas(const Posterior& posterior, const ParameterLayout& layout,
                          std::size_t capture, const Eigen::MatrixXd& gauge_projection) {
  const Eigen::Index n = gauge_projection.rows();
  const Eigen::MatrixXd covariance =
      gauge_projection *
      posterior.covariance.block(layout.Boxes(capture), layout.Boxes(capture), n, n) *
      gauge_projection.transpose();
  return covariance.diagonal().cwiseMax(0).cwiseSqrt();
}

}  // namespace volalign::refine_internal

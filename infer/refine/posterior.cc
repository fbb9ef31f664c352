#include "infer/refine/posterior.h"

#include <ceres/crs_matrix.h>
#include <ceres/problem.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "infer/refine/fine.h"

namespace volalign::refine_internal {

namespace {

/// px, standard deviation of the shift of silhouettes that all sensors have in common.
constexpr double kCommonEdgeShift = 0.3;

double Square(double x) { return x * x; }

/// J^T J, dense.
Eigen::MatrixXd Information(const ceres::CRSMatrix& jacobian) {
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(jacobian.num_cols, jacobian.num_cols);
  for (int row = 0; row < jacobian.num_rows; ++row) {
    const auto begin = static_cast<std::size_t>(jacobian.rows[static_cast<std::size_t>(row)]);
    const auto end = static_cast<std::size_t>(jacobian.rows[static_cast<std::size_t>(row) + 1]);
    for (std::size_t i = begin; i < end; ++i) {
      if (jacobian.values[i] == 0) continue;
      for (std::size_t j = begin; j < end; ++j)
        information(jacobian.cols[i], jacobian.cols[j]) += jacobian.values[i] * jacobian.values[j];
    }
  }
  return information;
}

}  // namespace

NormalEquations ComputeNormalEquations(const JointProblem& problem,
                                       const std::vector<SensorEvidence>& evidence,
                                       const std::vector<char>& kept_initial, State state) {
  const std::vector<char> none(static_cast<std::size_t>(problem.layout.size()), 0);
  const CeresProblem ceres = BuildFineProblem(problem, evidence, kept_initial, none, &state);
  ceres::Problem::EvaluateOptions evaluation;
  for (const ParameterLayout::Block& block : problem.layout.Blocks(&state))
    evaluation.parameter_blocks.push_back(block.values);
  evaluation.num_threads = problem.options.threads;
  ceres::CRSMatrix jacobian;
  std::vector<double> gradient;
  ceres.problem->Evaluate(evaluation, nullptr, nullptr, &gradient, &jacobian);
  NormalEquations normal;
  normal.information = Information(jacobian);
  normal.gradient = Eigen::Map<const Eigen::VectorXd>(gradient.data(), normal.information.rows());
  return normal;
}

Posterior ComputePosterior(const NormalEquations& normal, const ParameterLayout& layout,
                           const std::vector<char>& constant, double edge_shift) {
  const Eigen::MatrixXd& h = normal.information;
  const Eigen::LLT<Eigen::MatrixXd> root(h);
  Posterior posterior;
  posterior.covariance = root.solve(Eigen::MatrixXd::Identity(h.rows(), h.cols()));
  if (std::any_of(constant.begin(), constant.end(), [](char c) { return c != 0; })) {
    const Eigen::VectorXd step = root.solve(normal.gradient);
    posterior.covariance += step * step.transpose();
  }
  // How all parameters follow when every sensor's shifts grow by the same: what pulls on each shift
  // but its own prior.
  Eigen::VectorXd common = Eigen::VectorXd::Zero(h.rows());
  for (std::size_t i = 0; i < layout.sensors(); ++i) {
    for (const int shift : {kEdgeShift, kEdgeShift + 1}) {
      const Eigen::Index column = layout.Nuisance(i, shift);
      common += h.col(column);
      common[column] -= 1 / Square(Positive(edge_shift));
    }
  }
  const Eigen::VectorXd moved = kCommonEdgeShift * root.solve(common);
  posterior.covariance += moved * moved.transpose();
  return posterior;
}

Posterior ConditionalPosterior(const NormalEquations& normal, const std::vector<char>& constant) {
  Eigen::MatrixXd h = normal.information;
  for (std::size_t i = 0; i < constant.size(); ++i) {
    if (!constant[i]) continue;
    const auto k = static_cast<Eigen::Index>(i);
    h.row(k).setZero();
    h.col(k).setZero();
    h(k, k) = 1;
  }
  return {h.llt().solve(Eigen::MatrixXd(Eigen::MatrixXd::Identity(h.rows(), h.cols())))};
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
                          const Eigen::MatrixXd& gauge_projection) {
  const Eigen::Index n = gauge_projection.rows();
  const Eigen::MatrixXd covariance =
      gauge_projection * posterior.covariance.block(layout.Boxes(), layout.Boxes(), n, n) *
      gauge_projection.transpose();
  return covariance.diagonal().cwiseMax(0).cwiseSqrt();
}

}  // namespace volalign::refine_internal

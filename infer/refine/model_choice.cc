#include "infer/refine/model_choice.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "infer/refine/tune.h"

namespace volalign::refine_internal {

namespace {

/// Of a prior's standard deviation.
const std::array<double, 3> kScales = {0, Tune("VB_MID", 0.3), 1};
constexpr double kNegligible = 1e-3;  // weight of a model

}  // namespace

ModelFit FitModel(const QuadraticCost& cost, const Eigen::VectorXd& scales, bool with_covariance) {
  const Eigen::Index n = scales.size();
  std::vector<Eigen::Index> open, held;
  for (Eigen::Index k = 0; k < n; ++k) (scales[k] > 0 ? open : held).push_back(k);
  // Priors narrowed: their cost grows by extra / 2 * value^2.
  Eigen::MatrixXd h = cost.information;
  Eigen::VectorXd g = cost.gradient;
  for (const Eigen::Index k : open) {
    const double extra = (1 / (scales[k] * scales[k]) - 1) / (cost.prior_sigmas[k] * cost.prior_sigmas[k]);
    h(k, k) += extra;
    g[k] += extra * cost.values[k];
  }
  ModelFit fit;
  fit.step = Eigen::VectorXd::Zero(n);
  for (const Eigen::Index k : held) fit.step[k] = -cost.values[k];
  const Eigen::VectorXd pull = g + h * fit.step;
  const double held_cost = fit.step.dot(g + 0.5 * (h * fit.step));
  const auto size = static_cast<Eigen::Index>(open.size());
  Eigen::MatrixXd inner(size, size);
  Eigen::VectorXd b(size);
  double log_priors = 0, extra_cost = 0;
  for (Eigen::Index i = 0; i < size; ++i) {
    const Eigen::Index k = open[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 0; j < size; ++j) inner(i, j) = h(k, open[static_cast<std::size_t>(j)]);
    b[i] = pull[k];
    const double sigma = scales[k] * cost.prior_sigmas[k];
    log_priors += std::log(sigma);
    extra_cost += 0.5 * (1 / (sigma * sigma) - 1 / (cost.prior_sigmas[k] * cost.prior_sigmas[k])) *
                  cost.values[k] * cost.values[k];
  }
  const Eigen::LLT<Eigen::MatrixXd> root(inner);
  if (root.info() != Eigen::Success || !inner.allFinite()) {
    fit.log_evidence = -std::numeric_limits<double>::infinity();
    return fit;
  }
  const Eigen::VectorXd step = root.solve(-b);
  double log_root = 0;
  for (Eigen::Index i = 0; i < size; ++i) {
    fit.step[open[static_cast<std::size_t>(i)]] = step[i];
    log_root += std::log(root.matrixLLT()(i, i));
  }
  fit.log_evidence = -(held_cost + extra_cost + 0.5 * b.dot(step)) - log_root - log_priors;
  if (!with_covariance) return fit;
  const Eigen::MatrixXd inverse = root.solve(Eigen::MatrixXd::Identity(size, size));
  fit.covariance = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j < size; ++j)
      fit.covariance(open[static_cast<std::size_t>(i)], open[static_cast<std::size_t>(j)]) =
          inverse(i, j);
  }
  return fit;
}

std::vector<PriorScales> AllScales() {
  std::vector<PriorScales> all;
  for (const double boxes : kScales) {
    for (const double size : kScales) {
      for (const double gain : kScales) {
        for (const double offset : kScales) all.push_back({boxes, size, gain, offset});
      }
    }
  }
  return all;
}

PriorScales MostProbableScales(const QuadraticCost& cost, const ParameterLayout& layout,
                               const FreeSet& free) {
  const std::vector<char> constant = layout.Constant(free);
  PriorScales best;
  double most = -std::numeric_limits<double>::infinity();
  const bool print = Tune("VB_PRINT", 0) > 0;
  for (const PriorScales& scales : AllScales()) {
    Eigen::VectorXd of = layout.Scales(scales);
    for (Eigen::Index k = 0; k < of.size(); ++k) {
      if (constant[static_cast<std::size_t>(k)]) of[k] = 0;
    }
    const double evidence = FitModel(cost, of, false).log_evidence;
    if (print) fprintf(stderr, "  boxes %.1f size %.1f gain %.1f offset %.1f: %.2f\n", scales.boxes, scales.size, scales.gain, scales.offset, evidence);
    if (evidence > most) {
      most = evidence;
      best = scales;
    }
  }
  return best;
}

Eigen::MatrixXd CovarianceOverModels(const QuadraticCost& cost, const ParameterLayout& layout) {
  const std::vector<PriorScales> all = AllScales();
  std::vector<double> evidence;
  for (const PriorScales& scales : all)
    evidence.push_back(FitModel(cost, layout.Scales(scales), false).log_evidence);
  const double most = *std::max_element(evidence.begin(), evidence.end());
  if (!std::isfinite(most)) return {};
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(layout.size(), layout.size());
  double sum = 0;
  for (std::size_t m = 0; m < all.size(); ++m) {
    const double weight = std::exp(evidence[m] - most);
    if (weight < kNegligible) continue;
    const ModelFit fit = FitModel(cost, layout.Scales(all[m]), true);
    covariance += weight * (fit.covariance + fit.step * fit.step.transpose());
    sum += weight;
  }
  return covariance / sum;
}

}  // namespace volalign::refine_internal

#include "infer/refine/model_choice.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "infer/refine/fine_problem.h"

namespace volalign::refine_internal {

namespace {

/// Of a prior's standard deviation. Parameters that stray a third as far as they might are neither
/// nominal nor as loose as their priors leave them.
constexpr std::array<double, 3> kScales = {0, 0.3, 1};
constexpr double kNegligible = 1e-3;  // weight of one combination, of the best one's

/// All combinations, the nominal one first.
std::vector<PriorScales> AllScales() {
  std::vector<PriorScales> all{{0, 0, 0, 0, 0}};
  for (double PriorScales::*kind : {&PriorScales::places, &PriorScales::turns, &PriorScales::size,
                                    &PriorScales::gain, &PriorScales::offset}) {
    const std::vector<PriorScales> without = std::move(all);
    all.clear();
    for (const PriorScales& scales : without) {
      for (const double scale : kScales) {
        all.push_back(scales);
        all.back().*kind = scale;
      }
    }
  }
  return all;
}

/// The cost with narrower priors.
struct Narrowed {
  Eigen::MatrixXd information;
  Eigen::VectorXd gradient;
  double constant = 0;    // by which the cost at the solution is larger
  double log_priors = 0;  // sum of the logarithms of the standard deviations, without those held
};

Narrowed Narrow(const QuadraticCost& cost, const Eigen::VectorXd& scales,
                const std::vector<Eigen::Index>& open) {
  Narrowed narrowed{cost.normal.information, cost.normal.gradient};
  for (const Eigen::Index k : open) {
    const double sigma = scales[k] * cost.prior_sigmas[k];
    const double extra = (1 - scales[k] * scales[k]) / (sigma * sigma);  // of the precision
    narrowed.information(k, k) += extra;
    narrowed.gradient[k] += extra * cost.values[k];
    narrowed.constant += 0.5 * extra * cost.values[k] * cost.values[k];
    narrowed.log_priors += std::log(sigma);
  }
  return narrowed;
}

}  // namespace

QuadraticCost CostAround(const JointProblem& problem, const Solution& solution) {
  return {ComputeNormalEquations(problem, solution), PriorSigmas(problem, solution.evidence),
          problem.layout.Values(solution.state)};
}

ModelFit FitModel(const QuadraticCost& cost, const Eigen::VectorXd& scales, bool with_covariance) {
  ModelFit fit;
  fit.step = Eigen::VectorXd::Zero(scales.size());
  std::vector<Eigen::Index> open;
  for (Eigen::Index k = 0; k < scales.size(); ++k) {
    if (scales[k] > 0) {
      open.push_back(k);
    } else {
      fit.step[k] = -cost.values[k];
    }
  }
  const Narrowed narrowed = Narrow(cost, scales, open);
  const Eigen::VectorXd moved = narrowed.information * fit.step;
  const double held_cost = fit.step.dot(narrowed.gradient + 0.5 * moved);
  const Eigen::VectorXd pull = (narrowed.gradient + moved)(open);
  const Eigen::MatrixXd inner = narrowed.information(open, open);
  const Eigen::LLT<Eigen::MatrixXd> root(inner);
  if (root.info() != Eigen::Success || !inner.allFinite() || !pull.allFinite()) {
    fit.log_evidence = -std::numeric_limits<double>::infinity();
    return fit;
  }
  const Eigen::VectorXd step = -root.solve(pull);
  const double log_root = root.matrixLLT().diagonal().array().log().sum();
  fit.log_evidence =
      -(narrowed.constant + held_cost + 0.5 * pull.dot(step)) - log_root - narrowed.log_priors;
  for (std::size_t i = 0; i < open.size(); ++i)
    fit.step[open[i]] = step[static_cast<Eigen::Index>(i)];
  if (!with_covariance) return fit;
  const Eigen::MatrixXd inverse = root.solve(Eigen::MatrixXd::Identity(inner.rows(), inner.cols()));
  fit.covariance = Eigen::MatrixXd::Zero(scales.size(), scales.size());
  fit.covariance(open, open) = inverse;
  return fit;
}

MarginalCost WithoutAlwaysFree(const QuadraticCost& cost, const ParameterLayout& layout) {
  std::vector<Eigen::Index> free, others;
  for (Eigen::Index k = 0; k < layout.size(); ++k)
    (layout.IsAlwaysFree(k) ? free : others).push_back(k);
  const Eigen::MatrixXd& h = cost.normal.information;
  const Eigen::VectorXd& g = cost.normal.gradient;
  const Eigen::MatrixXd cross = h(free, others);
  const Eigen::LLT<Eigen::MatrixXd> root(h(free, free));
  MarginalCost marginal;
  marginal.cost.normal.information = h(others, others) - cross.transpose() * root.solve(cross);
  marginal.cost.normal.gradient =
      g(others) - cross.transpose() * root.solve(Eigen::VectorXd(g(free)));
  marginal.cost.prior_sigmas = cost.prior_sigmas(others);
  marginal.cost.values = cost.values(others);
  marginal.columns = std::move(others);
  return marginal;
}

PriorScales MostProbableScales(const QuadraticCost& cost, const ParameterLayout& layout,
                               const FreeSet& free) {
  const std::vector<char> constant = layout.Constant(free);
  const MarginalCost marginal = WithoutAlwaysFree(cost, layout);
  PriorScales best{0, 0, 0, 0, 0};
  double most = -std::numeric_limits<double>::infinity();
  for (const PriorScales& scales : AllScales()) {
    Eigen::VectorXd of_all = layout.Scales(scales);
    for (Eigen::Index k = 0; k < of_all.size(); ++k) {
      if (constant[static_cast<std::size_t>(k)]) of_all[k] = 0;
    }
    const double evidence = FitModel(marginal.cost, of_all(marginal.columns), false).log_evidence;
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
  evidence.reserve(all.size());
  const MarginalCost marginal = WithoutAlwaysFree(cost, layout);
  for (const PriorScales& scales : all) {
    const Eigen::VectorXd of_all = layout.Scales(scales);
    evidence.push_back(FitModel(marginal.cost, of_all(marginal.columns), false).log_evidence);
  }
  const double most = *std::max_element(evidence.begin(), evidence.end());
  if (!std::isfinite(most)) return {};
  const Eigen::VectorXd common =
      CommonShiftPull(cost.normal.information, layout, cost.prior_sigmas);
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(layout.size(), layout.size());
  double weights = 0;
  for (std::size_t m = 0; m < all.size(); ++m) {
    const double weight = std::exp(evidence[m] - most);
    if (weight < kNegligible) continue;
    const ModelFit fit = FitModel(cost, layout.Scales(all[m]), true);
    const Eigen::VectorXd follows = fit.covariance * common;
    sum +=
        weight * (fit.covariance + fit.step * fit.step.transpose() + follows * follows.transpose());
    weights += weight;
  }
  return sum / weights;
}

}  // namespace volalign::refine_internal

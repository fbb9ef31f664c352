#include "infer/refine/model_choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "core/geometry/factor.h"
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
  return {ComputeNormalEquations(problem, solution), PriorSigmas(problem, solution.observed),
          problem.layout.Values(solution.state)};
}

std::optional<ModelFit> FitModel(const QuadraticCost& cost, const Eigen::VectorXd& scales,
                                 bool with_covariance) {
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
  const std::optional<CholeskyFactor> factor = Factor(narrowed.information(open, open));
  if (!factor) return std::nullopt;
  const Eigen::VectorXd step = -factor->solve(pull);
  fit.log_evidence = -(narrowed.constant + held_cost + 0.5 * pull.dot(step)) - LogRoot(*factor) -
                     narrowed.log_priors;
  if (!step.allFinite() || !std::isfinite(fit.log_evidence)) return std::nullopt;
  for (std::size_t i = 0; i < open.size(); ++i)
    fit.step[open[i]] = step[static_cast<Eigen::Index>(i)];
  if (!with_covariance) return fit;
  const Eigen::MatrixXd inverse =
      factor->solve(Eigen::MatrixXd::Identity(factor->rows(), factor->cols()));
  fit.covariance = Eigen::MatrixXd::Zero(scales.size(), scales.size());
  fit.covariance(open, open) = inverse;
  return fit;
}

std::optional<MarginalCost> WithoutAlwaysFree(const QuadraticCost& cost,
                                              const ParameterLayout& layout) {
  std::vector<Eigen::Index> free, others;
  for (Eigen::Index k = 0; k < layout.size(); ++k)
    (layout.IsAlwaysFree(k) ? free : others).push_back(k);
  const Eigen::MatrixXd& h = cost.normal.information;
  const Eigen::VectorXd& g = cost.normal.gradient;
  const Eigen::MatrixXd cross = h(free, others);
  const std::optional<CholeskyFactor> factor = Factor(h(free, free));
  if (!factor) return std::nullopt;
  MarginalCost marginal;
  marginal.cost.normal.information = h(others, others) - cross.transpose() * factor->solve(cross);
  marginal.cost.normal.gradient =
      g(others) - cross.transpose() * factor->solve(Eigen::VectorXd(g(free)));
  marginal.cost.prior_sigmas = cost.prior_sigmas(others);
  marginal.cost.values = cost.values(others);
  marginal.columns = std::move(others);
  return marginal;
}

std::optional<PriorScales> MostProbableScales(const QuadraticCost& cost,
                                              const ParameterLayout& layout, const FreeSet& free) {
  const std::vector<char> constant = layout.Constant(free);
  const std::optional<MarginalCost> marginal = WithoutAlwaysFree(cost, layout);
  if (!marginal) return std::nullopt;
  std::optional<PriorScales> best;
  double most = -std::numeric_limits<double>::infinity();
  for (const PriorScales& scales : AllScales()) {
    Eigen::VectorXd of_all = layout.Scales(scales);
    for (Eigen::Index k = 0; k < of_all.size(); ++k) {
      if (constant[static_cast<std::size_t>(k)]) of_all[k] = 0;
    }
    const std::optional<ModelFit> fit = FitModel(marginal->cost, of_all(marginal->columns), false);
    if (fit && fit->log_evidence > most) {
      most = fit->log_evidence;
      best = scales;
    }
  }
  return best;
}

std::optional<Eigen::MatrixXd> CovarianceOverModels(const QuadraticCost& cost,
                                                    const ParameterLayout& layout) {
  const std::optional<MarginalCost> marginal = WithoutAlwaysFree(cost, layout);
  if (!marginal) return std::nullopt;
  struct Weighed {
    Eigen::VectorXd scales;
    double log_evidence;
  };
  std::vector<Weighed> models;
  double most = -std::numeric_limits<double>::infinity();
  for (const PriorScales& scales : AllScales()) {
    const Eigen::VectorXd of_all = layout.Scales(scales);
    const std::optional<ModelFit> fit = FitModel(marginal->cost, of_all(marginal->columns), false);
    if (!fit) continue;
    models.push_back({of_all, fit->log_evidence});
    most = std::max(most, fit->log_evidence);
  }
  const Eigen::VectorXd common =
      CommonShiftPull(cost.normal.information, layout, cost.prior_sigmas);
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(layout.size(), layout.size());
  double weights = 0;
  for (const Weighed& model : models) {
    const double weight = std::exp(model.log_evidence - most);
    if (weight < kNegligible) continue;
    const std::optional<ModelFit> fit = FitModel(cost, model.scales, true);
    if (!fit) continue;
    const Eigen::VectorXd follows = fit->covariance * common;
    sum += weight *
           (fit->covariance + fit->step * fit->step.transpose() + follows * follows.transpose());
    weights += weight;
  }
  if (weights == 0 || !sum.allFinite()) return std::nullopt;
  return sum / weights;
}

}  // namespace volalign::refine_internal

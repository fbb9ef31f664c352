#include "infer/refine/model_choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/parallel_for.h"
#include "core/geometry/factor.h"
#include "infer/refine/terms.h"

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
  for (Eigen::Index k = 0; k < layout.size(); ++k) {
    (layout.IsAlwaysFree(k) ? free : others).push_back(k);
  }
  const Eigen::MatrixXd& h = cost.normal.information;
  const Eigen::VectorXd& g = cost.normal.gradient;
  const Eigen::MatrixXd cross = h(free, others);
  const std::optional<CholeskyFactor> factor = Factor(h(free, free));
  if (!factor) return std::nullopt;
  MarginalCost marginal;
  marginal.follows = -factor->solve(cross);
  marginal.free_step = -factor->solve(Eigen::VectorXd(g(free)));
  marginal.free_covariance =
      factor->solve(Eigen::MatrixXd::Identity(factor->rows(), factor->cols()));
  marginal.free = std::move(free);
  marginal.cost.normal.information = h(others, others) + cross.transpose() * marginal.follows;
  marginal.cost.normal.gradient = g(others) + cross.transpose() * marginal.free_step;
  marginal.cost.prior_sigmas = cost.prior_sigmas(others);
  marginal.cost.values = cost.values(others);
  marginal.columns = std::move(others);
  return marginal;
}

namespace {

constexpr double kNoEvidence = -std::numeric_limits<double>::infinity();  // cannot be computed

/// Of each of `all`, with the columns marked in `constant` held.
std::vector<double> LogEvidence(const MarginalCost& marginal, const ParameterLayout& layout,
                                const std::vector<PriorScales>& all,
                                const std::vector<char>& constant, int threads) {
  std::vector<double> evidence(all.size(), kNoEvidence);
  ParallelFor(all.size(), threads, [&](std::size_t k) {
    Eigen::VectorXd scales = layout.Scales(all[k]);
    for (Eigen::Index column = 0; column < scales.size(); ++column) {
      if (constant[static_cast<std::size_t>(column)]) scales[column] = 0;
    }
    const std::optional<ModelFit> fit = FitModel(marginal.cost, scales(marginal.columns), false);
    if (fit) evidence[k] = fit->log_evidence;
  });
  return evidence;
}

}  // namespace

std::optional<PriorScales> MostProbableScales(const QuadraticCost& cost,
                                              const ParameterLayout& layout, const FreeSet& free,
                                              int threads) {
  const std::optional<MarginalCost> marginal = WithoutAlwaysFree(cost, layout);
  if (!marginal) return std::nullopt;
  const std::vector<PriorScales> all = AllScales();
  const std::vector<double> evidence =
      LogEvidence(*marginal, layout, all, layout.Constant(free), threads);
  const auto best = std::max_element(evidence.begin(), evidence.end());
  if (*best == kNoEvidence) return std::nullopt;
  return all[static_cast<std::size_t>(best - evidence.begin())];
}

std::optional<Eigen::MatrixXd> CovarianceOverModels(const QuadraticCost& cost,
                                                    const ParameterLayout& layout, int threads) {
  const std::optional<MarginalCost> marginal = WithoutAlwaysFree(cost, layout);
  if (!marginal) return std::nullopt;
  const std::vector<PriorScales> all = AllScales();
  const std::vector<double> evidence =
      LogEvidence(*marginal, layout, all,
                  std::vector<char>(static_cast<std::size_t>(layout.size()), 0), threads);
  const double most = *std::max_element(evidence.begin(), evidence.end());
  const auto n = static_cast<Eigen::Index>(marginal->columns.size());
  Eigen::MatrixXd square = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd step = Eigen::VectorXd::Zero(n);
  double weights = 0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    const double weight = std::exp(evidence[k] - most);
    if (evidence[k] == kNoEvidence || weight < kNegligible) continue;
    const std::optional<ModelFit> fit =
        FitModel(marginal->cost, layout.Scales(all[k])(marginal->columns), true);
    if (!fit) continue;
    square += weight * (fit->covariance + fit->step * fit->step.transpose());
    step += weight * fit->step;
    weights += weight;
  }
  if (weights == 0) return std::nullopt;
  square /= weights;
  step /= weights;
  // What is always free takes free_step + follows * step, about which it has free_covariance.
  const Eigen::MatrixXd crossed =
      marginal->follows * square + marginal->free_step * step.transpose();
  const Eigen::MatrixXd of_free =
      marginal->free_covariance + crossed * marginal->follows.transpose() +
      (marginal->free_step + marginal->follows * step) * marginal->free_step.transpose();
  Eigen::MatrixXd covariance(layout.size(), layout.size());
  covariance(marginal->columns, marginal->columns) = square;
  covariance(marginal->free, marginal->columns) = crossed;
  covariance(marginal->columns, marginal->free) = crossed.transpose();
  covariance(marginal->free, marginal->free) = of_free;
  if (!covariance.allFinite()) return std::nullopt;
  return covariance;
}

}  // namespace volalign::refine_internal

#include "infer/refine/prior_scales.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/geometry/factor.h"
#include "infer/refine/terms.h"

namespace volalign::refine_internal {

namespace {

constexpr double kLeastScale = 0.02;
constexpr int kUpdates = 40;  // of expectation maximisation

/// The additional precision of the narrower prior.
double ExtraPrecision(const QuadraticCost& cost, const Eigen::VectorXd& scales, Eigen::Index k) {
  return (1 / (scales[k] * scales[k]) - 1) / (cost.prior_sigmas[k] * cost.prior_sigmas[k]);
}

}  // namespace

QuadraticCost CostAround(const JointProblem& problem, const Solution& solution) {
  return {ComputeNormalEquations(problem, solution), PriorSigmas(problem, solution.observed),
          problem.layout.Values(solution.state)};
}

NormalEquations WithScaledPriors(const QuadraticCost& cost, const Eigen::VectorXd& scales) {
  NormalEquations normal = cost.normal;
  for (Eigen::Index k = 0; k < scales.size(); ++k) {
    if (scales[k] == 0) continue;
    const double extra = ExtraPrecision(cost, scales, k);
    normal.information(k, k) += extra;
    normal.gradient[k] += extra * cost.values[k];
  }
  return normal;
}

std::optional<ModelFit> FitModel(const QuadraticCost& cost, const Eigen::VectorXd& scales,
                                 bool with_covariance) {
  ModelFit fit;
  fit.step = Eigen::VectorXd::Zero(scales.size());
  std::vector<Eigen::Index> open;
  double priors = 0;  // their additional cost at the solution, and the logarithms of their sigmas
  for (Eigen::Index k = 0; k < scales.size(); ++k) {
    if (scales[k] > 0) {
      open.push_back(k);
      priors += 0.5 * ExtraPrecision(cost, scales, k) * cost.values[k] * cost.values[k] +
                std::log(scales[k] * cost.prior_sigmas[k]);
    } else {
      fit.step[k] = -cost.values[k];
    }
  }
  const NormalEquations narrowed = WithScaledPriors(cost, scales);
  const Eigen::VectorXd moved = narrowed.information * fit.step;
  const double held_cost = fit.step.dot(narrowed.gradient + 0.5 * moved);
  const Eigen::VectorXd pull = (narrowed.gradient + moved)(open);
  const std::optional<CholeskyFactor> factor = Factor(narrowed.information(open, open));
  if (!factor) return std::nullopt;
  const Eigen::VectorXd step = -factor->solve(pull);
  fit.log_evidence = -(held_cost + 0.5 * pull.dot(step)) - LogRoot(*factor) - priors;
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
  std::optional<NormalEquations> normal = Marginal(cost.normal, others, free);
  if (!normal) return std::nullopt;
  MarginalCost marginal{{std::move(*normal), cost.prior_sigmas(others), cost.values(others)}, {}};
  marginal.columns = std::move(others);
  return marginal;
}

std::optional<PriorScales> EstimatePriorScales(const QuadraticCost& cost,
                                               const ParameterLayout& layout, const FreeSet& free) {
  const std::optional<MarginalCost> marginal = WithoutAlwaysFree(cost, layout);
  if (!marginal) return std::nullopt;
  const std::vector<char> constant = layout.Constant(free);
  PriorScales scales = kWholePriors;
  for (int update = 0; update < kUpdates; ++update) {
    Eigen::VectorXd of_all = layout.Scales(scales);
    for (Eigen::Index k = 0; k < of_all.size(); ++k) {
      if (constant[static_cast<std::size_t>(k)]) of_all[k] = 0;
    }
    const Eigen::VectorXd of = of_all(marginal->columns);
    const std::optional<ModelFit> fit = FitModel(marginal->cost, of, true);
    if (!fit) return std::nullopt;
    const Eigen::VectorXd squares =
        ((marginal->cost.values + fit->step).cwiseAbs2() + fit->covariance.diagonal())
            .cwiseQuotient(marginal->cost.prior_sigmas.cwiseAbs2());
    PriorScales sums{}, counts{};
    for (std::size_t k = 0; k < marginal->columns.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      const int group = layout.GroupOf(marginal->columns[k]);
      if (of[i] == 0 || group == kPriorGroups) continue;
      sums[static_cast<std::size_t>(group)] += squares[i];
      ++counts[static_cast<std::size_t>(group)];
    }
    for (std::size_t g = 0; g < kPriorGroups; ++g) {
      if (counts[g] > 0) scales[g] = std::clamp(std::sqrt(sums[g] / counts[g]), kLeastScale, 1.0);
    }
  }
  return scales;
}

PriorScales WidenedScales(const ParameterLayout& layout, const FreeSet& free,
                          const PriorScales& scales) {
  const std::vector<char> constant = layout.Constant(free);
  PriorScales counts{}, widened{};
  for (Eigen::Index k = 0; k < layout.size(); ++k) {
    const int group = layout.GroupOf(k);
    if (group != kPriorGroups && !constant[static_cast<std::size_t>(k)])
      ++counts[static_cast<std::size_t>(group)];
  }
  for (std::size_t g = 0; g < kPriorGroups; ++g)
    widened[g] = std::sqrt((scales[g] * scales[g] * counts[g] + 1) / (counts[g] + 1));
  return widened;
}

Solution SolveWithScaledPriors(const JointProblem& problem, Solution solution) {
  const QuadraticCost cost = CostAround(problem, solution);
  const Posterior posterior =
      ComputePosterior(cost.normal, problem.layout.Constant(solution.free), cost.prior_sigmas);
  Solution scaled = solution;
  for (std::size_t lens = 0; lens < problem.lenses.size(); ++lens) {
    constexpr int kSize = kLensParameters;
    const Eigen::Index column = problem.layout.Lens(lens);
    const LensEstimate estimate{solution.state.lenses[lens],
                                posterior.covariance.block<kSize, kSize>(column, column)};
    if (!scaled.free.lens[lens] ||
        LogBayesFactor(estimate, cost.prior_sigmas.segment<kSize>(column)) > kBelievedLens)
      continue;
    scaled.free.lens[lens] = 0;
    scaled.state.lenses[lens].setZero();
    for (std::size_t i = 0; i < problem.size(); ++i) {
      if (solution.state.LensOf(i) == lens) scaled.state.Errors(i)[kFocal] = 0;
    }
  }
  const std::optional<PriorScales> scales = EstimatePriorScales(cost, problem.layout, scaled.free);
  if (!scales) return solution;
  scaled.state.scales = *scales;
  // A single view does not separate the boxes' places from its own.
  if (problem.size() == 1) SetLineTolerance(problem, kHeldEdge, &scaled);
  return Solve(problem, &scaled) ? scaled : solution;
}

}  // namespace volalign::refine_internal

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

/// The free parameters of each group. One that is known by its prior says nothing about the others.
std::vector<std::vector<Eigen::Index>> GroupsOf(const Eigen::VectorXd& prior_sigmas,
                                                const ParameterLayout& layout,
                                                const FreeSet& free) {
  const std::vector<char> constant = layout.Constant(free);
  std::vector<std::vector<Eigen::Index>> groups(kPriorGroups);
  for (Eigen::Index k = 0; k < layout.size(); ++k) {
    const std::optional<PriorGroup> group = layout.GroupOf(k);
    if (group && !constant[static_cast<std::size_t>(k)] && prior_sigmas[k] > Positive(0))
      groups[*group].push_back(k);
  }
  return groups;
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

std::optional<PriorScales> EstimatePriorScales(const QuadraticCost& cost,
                                               const ParameterLayout& layout, const FreeSet& free) {
  const std::vector<std::vector<Eigen::Index>> groups = GroupsOf(cost.prior_sigmas, layout, free);
  const std::vector<char> constant = layout.Constant(free);
  const auto is_constant = [&](Eigen::Index k) {
    return constant[static_cast<std::size_t>(k)] != 0;
  };
  // Parameters whose priors are never narrowed are at their best for all others.
  std::vector<Eigen::Index> kept, others;
  for (Eigen::Index k = 0; k < layout.size(); ++k)
    (layout.GroupOf(k) || is_constant(k) ? kept : others).push_back(k);
  std::optional<NormalEquations> normal = Marginal(cost.normal, kept, others);
  if (!normal) return std::nullopt;
  const QuadraticCost marginal{std::move(*normal), cost.prior_sigmas(kept), cost.values(kept)};
  PriorScales scales = PriorScales::Ones();
  for (int update = 0; update < kUpdates; ++update) {
    Eigen::VectorXd of = layout.Scales(scales);
    for (Eigen::Index k = 0; k < of.size(); ++k) {
      if (is_constant(k)) of[k] = 0;
    }
    const std::optional<ModelFit> fit = FitModel(marginal, of(kept), true);
    if (!fit) return std::nullopt;
    Eigen::VectorXd squares(layout.size());
    squares(kept) = ((marginal.values + fit->step).cwiseAbs2() + fit->covariance.diagonal())
                        .cwiseQuotient(marginal.prior_sigmas.cwiseAbs2());
    for (std::size_t g = 0; g < groups.size(); ++g) {
      if (groups[g].empty()) continue;
      scales[static_cast<Eigen::Index>(g)] =
          std::clamp(std::sqrt(squares(groups[g]).mean()), kLeastScale, 1.0);
    }
  }
  return scales;
}

PriorScales WidenedScales(const Eigen::VectorXd& prior_sigmas, const ParameterLayout& layout,
                          const FreeSet& free, const PriorScales& scales) {
  PriorScales widened = scales;
  const std::vector<std::vector<Eigen::Index>> groups = GroupsOf(prior_sigmas, layout, free);
  for (std::size_t g = 0; g < groups.size(); ++g) {
    const auto n = static_cast<double>(groups[g].size());
    double& scale = widened[static_cast<Eigen::Index>(g)];
    scale = std::sqrt((scale * scale * n + 1) / (n + 1));
  }
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
      if (solution.state.frame_of[i].lens == lens) scaled.state.Errors(i)[kFocal] = 0;
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

#include "infer/refine/box_edges.h"

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "core/geometry/stack_faults.h"
#include "infer/refine/prior_scales.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

constexpr int kAxes = Eigen::Vector3d::SizeAtCompileTime;

}  // namespace

Structure WithEdge(const Structure& structure, int box, int axis, double change) {
  std::vector<Box> boxes = structure.boxes();
  const auto b = static_cast<std::size_t>(box);
  if (std::abs(boxes[b].structure_from_box.linear()(1, axis)) > kFacesAlike) {
    for (const std::size_t above : BoxesOn(structure.boxes(), b))
      boxes[above].structure_from_box.translation().y() += change;
    boxes[b].structure_from_box.translation().y() += change / 2;
  }
  boxes[b].size[axis] += change;
  return Structure::FromBoxes(structure.name(), std::move(boxes), structure.SideNames());
}

std::optional<RefinedEdge> LikeliestEdge(const JointProblem& problem, const Solution& solution) {
  // m: prior standard deviation of an edge's error.
  constexpr double kUnit = kSamePlace;
  const auto boxes = static_cast<int>(problem.structure.boxes().size());
  std::vector<Structure> changed;
  for (int edge = 0; edge < kAxes * boxes; ++edge)
    changed.push_back(WithEdge(problem.structure, edge / kAxes, edge % kAxes, kUnit));
  const QuadraticCost known = CostAround(problem, solution);
  QuadraticCost cost{ComputeNormalEquations(problem, solution, changed), {}, {}};
  if (!known.normal.evaluated || !cost.normal.evaluated) return std::nullopt;
  const Eigen::Index first = problem.layout.size(), count = kAxes * boxes;
  cost.normal.information.diagonal().tail(count).array() += 1;
  cost.prior_sigmas = Eigen::VectorXd::Ones(first + count);
  cost.prior_sigmas.head(first) = known.prior_sigmas;
  cost.values = Eigen::VectorXd::Zero(first + count);
  cost.values.head(first) = known.values;
  Eigen::VectorXd scales = Eigen::VectorXd::Ones(first + count);
  scales.tail(count).setZero();
  const std::optional<ModelFit> common = FitModel(cost, scales, false);
  if (!common) return std::nullopt;
  scales[problem.layout.Size()] = 0;
  const auto fit_of = [&](Eigen::Index edge, bool with_covariance) {
    scales.tail(count).setZero();
    scales[first + edge] = 1;
    return FitModel(cost, scales, with_covariance);
  };
  std::optional<std::pair<double, Eigen::Index>> best;  // log evidence, edge
  for (Eigen::Index edge = 0; edge < count; ++edge) {
    const std::optional<ModelFit> fit = fit_of(edge, false);
    if (fit && (!best || fit->log_evidence > best->first))
      best = std::pair(fit->log_evidence, edge);
  }
  if (!best) return std::nullopt;
  const Eigen::Index edge = best->second, column = first + edge;
  const std::optional<ModelFit> fit = fit_of(edge, true);
  if (!fit) return std::nullopt;
  // Any of the edges may be wrong, each with the same probability.
  const double log_odds = best->first - common->log_evidence - std::log(static_cast<double>(count));
  return RefinedEdge{static_cast<int>(edge) / kAxes, static_cast<int>(edge) % kAxes,
                     kUnit * fit->step[column], kUnit * std::sqrt(fit->covariance(column, column)),
                     log_odds};
}

}  // namespace volalign::refine_internal

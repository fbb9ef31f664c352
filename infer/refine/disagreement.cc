#include "infer/refine/disagreement.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

#include "core/base/parallel_for.h"
#include "core/base/statistics.h"
#include "core/geometry/factor.h"
#include "infer/refine/residuals.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

constexpr double kShownBy = 0.5;  // share of the largest contradiction
/// Most by which noise models may understate variances. Four real Kinects: 2.8; simulated ones: 0.4
/// to 1.4.
constexpr double kMostVarianceFactor = 3;
/// See DisagreementOf. Nothing predicts the first `unpredicted` of the frame's parameters.
Innovation InnovationOf(const OwnMeasurements& own, const NormalEquations& predicted,
                        const QuadraticCost& priors, const std::vector<char>& constant,
                        std::size_t unpredicted) {
  // The frame's parameters that others determine, too, among its columns and among all; its own
  // ones, among its columns, with their priors; and the others' own ones, among all.
  std::vector<Eigen::Index> shared, shared_columns, alone, others;
  NormalEquations with_priors = own.normal;
  std::vector<char> left_out = constant;  // of the others' own ones
  for (std::size_t k = 0; k < own.columns.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    const Eigen::Index column = own.columns[k];
    if (constant[static_cast<std::size_t>(column)]) continue;
    const double precision = 1 / Square(priors.prior_sigmas[column]);
    // Known better than by its prior, up to rounding.
    if (k >= unpredicted && predicted.information(column, column) >
                                (1 + std::numeric_limits<float>::epsilon()) * precision) {
      shared.push_back(i);
      shared_columns.push_back(column);
      left_out[static_cast<std::size_t>(column)] = 1;
    } else {
      alone.push_back(i);
      with_priors.information(i, i) += precision;
      with_priors.gradient[i] += precision * priors.values[column];
    }
  }
  for (std::size_t k = 0; k < left_out.size(); ++k) {
    if (!left_out[k]) others.push_back(static_cast<Eigen::Index>(k));
  }
  if (shared.empty()) return {};
  const std::optional<NormalEquations> said = Marginal(with_priors, shared, alone),
                                       known = Marginal(predicted, shared_columns, others);
  const std::optional<CholeskyFactor> factor = known ? Factor(known->information) : std::nullopt;
  if (!said || !factor) return {};
  const Eigen::VectorXd unit = priors.prior_sigmas(shared_columns);
  const Eigen::MatrixXd information = unit.asDiagonal() * said->information * unit.asDiagonal();
  if (!information.allFinite() || !said->gradient.allFinite()) return {};
  // Along the eigenvectors the frame measures independent numbers, each with a variance of 1.
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(information);
  const Eigen::Index count = (solver.eigenvalues().array() > kNotable).count();
  if (count == 0) return {};
  const Eigen::VectorXd roots = solver.eigenvalues().tail(count).cwiseSqrt();
  const Eigen::MatrixXd vectors = solver.eigenvectors().rightCols(count).transpose();
  const Eigen::MatrixXd by = roots.asDiagonal() * vectors * unit.cwiseInverse().asDiagonal();
  const Eigen::VectorXd innovation =
      roots.cwiseInverse().asDiagonal() * (vectors * unit.cwiseProduct(said->gradient)) -
      by * factor->solve(known->gradient);
  Eigen::MatrixXd covariance = by * factor->solve(Eigen::MatrixXd(by.transpose()));
  covariance.diagonal().array() += 1;
  const double cost = 0.5 * innovation.dot(covariance.ldlt().solve(innovation));
  return std::isfinite(cost) ? Innovation{cost, static_cast<std::size_t>(count)} : Innovation();
}

}  // namespace

OwnMeasurements MeasurementsOf(const JointProblem& problem, const Solution& solution,
                               std::size_t frame) {
  const FrameParameters parameters = solution.state.Parameters(frame);
  std::vector<Eigen::Index> all(
      static_cast<std::size_t>(FrameColumns::kBoxes + problem.model.size().parameters()));
  std::iota(all.begin(), all.end(), 0);
  Eigen::VectorXd r;
  Eigen::MatrixXd over_blocks;
  WhitenedResiduals(problem.model, solution.observed[frame], parameters, all, &r, &over_blocks);
  const Eigen::MatrixXd j = FrameColumns::InTangentSpace(over_blocks, parameters.pose);
  return {problem.layout.ColumnsOf(frame), {j.transpose() * j, j.transpose() * r}};
}

bool Innovation::IsUnlikely(double freedom) const {
  if (predicted == 0) return false;
  const double n = static_cast<double>(predicted), root = std::cbrt(2 * cost / n);
  const double spread = 2 / (9 * n), of_noise = 2 / (9 * freedom);
  return root * (1 - of_noise) - (1 - spread) >
         kClearly * std::hypot(root * std::sqrt(of_noise), std::sqrt(spread));
}

Disagreement DisagreementOf(const OwnMeasurements& own, const NormalEquations& predicted,
                            const QuadraticCost& priors, const std::vector<char>& constant) {
  const auto all = InnovationOf(own, predicted, priors, constant, 0);
  const auto of_build = InnovationOf(own, predicted, priors, constant, 6);
  if (of_build.predicted >= all.predicted) return {all, {}};
  return {all, {all.cost - of_build.cost, all.predicted - of_build.predicted}};
}

namespace {

/// `free`, with all of the build that the priors leave open.
FreeSet WithBuild(const JointProblem& problem, FreeSet free) {
  free.boxes = problem.priors.box > 0;
  free.size = problem.priors.size > 0;
  return free;
}

/// A solution's cost with whole priors, and each frame's own part in it.
struct CostByFrame {
  CostByFrame(const JointProblem& problem, const Solution& solution, const FreeSet& asked_for)
      : all(CostAround(problem, solution)),
        constant(problem.layout.Constant(asked_for)),
        own(problem.size()) {
    ParallelFor(problem.size(), problem.setup.threads, [&](std::size_t i) {
      if (!solution.fixed[i] && !solution.observed[i].faces.empty())
        own[i] = MeasurementsOf(problem, solution, i);
    });
  }
  /// A frame's, predicted by all others.
  Disagreement Of(std::size_t frame) const {
    if (!own[frame]) return {};
    NormalEquations others = all.normal;
    Add(*own[frame], -1, &others);
    return DisagreementOf(*own[frame], others, all, constant);
  }
  /// A frame's, predicted by another one.
  Disagreement Of(std::size_t frame, std::size_t by) const {
    if (!own[frame] || !own[by]) return {};
    const Eigen::VectorXd precisions = all.prior_sigmas.cwiseAbs2().cwiseInverse();
    NormalEquations other{precisions.asDiagonal(), precisions.cwiseProduct(all.values)};
    Add(*own[by], 1, &other);
    return DisagreementOf(*own[frame], other, all, constant);
  }
  static void Add(const OwnMeasurements& own, double times, NormalEquations* normal) {
    normal->information(own.columns, own.columns) += times * own.normal.information;
    normal->gradient(own.columns) += times * own.normal.gradient;
  }

  QuadraticCost all;
  std::vector<char> constant;
  std::vector<std::optional<OwnMeasurements>> own;  // nothing without faces
};

/// Divides the costs by the variance factor of all frames: how much farther off the median frame is
/// than its noise model expects. Pope, "The Statistics of Residuals and the Detection of Outliers",
/// 1976, but with the median.
void ScaleByVarianceFactor(std::vector<Disagreement>* measured) {
  std::vector<double> factors;
  for (const Disagreement& of : *measured) {
    if (of.predicted > 0) factors.push_back(2 * of.cost / static_cast<double>(of.predicted));
  }
  if (factors.empty()) return;
  const double factor = std::clamp(Quantile(std::move(factors), 0.5), 1.0, kMostVarianceFactor);
  for (Disagreement& of : *measured) {
    of.cost /= factor;
    of.of_pose.cost /= factor;
  }
}

/// The frames of the same capture that a frame contradicts most, or at least half as much.
std::vector<int> FindContradicted(const JointProblem& problem, const CostByFrame& cost,
                                  std::size_t frame) {
  std::vector<std::pair<double, int>> others;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (i != frame && problem.frame_of[i].capture == problem.frame_of[frame].capture && cost.own[i])
      others.emplace_back(-cost.Of(frame, i).cost, static_cast<int>(i));
  }
  std::sort(others.begin(), others.end());
  std::vector<int> contradicted;
  for (const auto& [negative, i] : others) {
    if (negative < kShownBy * others.front().first) contradicted.push_back(i);
  }
  return contradicted;
}

/// Does a frame disagree, or is it unusual and its sensor has another frame?
bool IsOdd(const JointProblem& problem, const Agreed& agreed, std::size_t frame) {
  bool has_another = false;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    has_another = has_another || (i != frame && !agreed.solution.fixed[i] &&
                                  problem.frame_of[i].sensor == problem.frame_of[frame].sensor);
  }
  const Disagreement& measured = agreed.measured[frame];
  return measured.Disagrees() ||
         (has_another && measured.IsUnlikely(std::numeric_limits<double>::infinity()));
}

/// May this frame be excluded, too? Yes if its sensor has three frames or more and most of these
/// stay. Yes also if most sensors stay without an excluded frame.
bool LeavesMajority(const JointProblem& problem, const Agreed& agreed,
                    const std::vector<char>& takes_part, std::size_t frame) {
  std::map<std::size_t, std::pair<int, int>> of_sensor;  // its frames, and the excluded ones
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!takes_part[i]) continue;
    auto& [frames, excluded] = of_sensor[agreed.solution.state.frame_of[i].sensor];
    ++frames;
    excluded += agreed.of[i] || i == frame ? 1 : 0;
  }
  const auto& [frames, excluded] = of_sensor[agreed.solution.state.frame_of[frame].sensor];
  if (frames >= 3 && 2 * excluded < frames) return true;
  const auto doubted = std::count_if(of_sensor.begin(), of_sensor.end(),
                                     [](const auto& sensor) { return sensor.second.second > 0; });
  return 2 * static_cast<std::size_t>(doubted) < of_sensor.size();
}

/// The most probable solution by a frame's own measurements and the priors, with the lens known. It
/// begins at the frame's start, since others may have pulled the frame too far away.
std::optional<Solution> SolveAlone(const JointProblem& problem, const FreeSet& asked_for,
                                   std::size_t frame, Solution solution) {
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (i != frame) HoldFrame(problem, i, &solution);
  }
  solution.state.poses[frame] = PoseBlock(problem.frames[frame].start);
  solution.free = asked_for;
  std::fill(solution.free.lens.begin(), solution.free.lens.end(), 0);
  solution.state.scales = PriorScales::Ones();
  Solution alone = AssociateAndSolve(problem, std::move(solution));
  if (alone.fixed[frame]) return std::nullopt;
  return alone;
}

/// Solves again, beginning with whole priors.
std::optional<Solution> SolveAnew(const JointProblem& problem, const FreeSet& asked_for,
                                  Solution solution) {
  solution.free = asked_for;
  solution.state.scales = PriorScales::Ones();
  SetLineTolerance(problem, LineTolerance(asked_for), &solution);
  if (!Solve(problem, &solution)) return std::nullopt;
  return SolveWithScaledPriors(problem, std::move(solution));
}

/// Solves without a frame, which stays at a pose.
std::optional<Solution> SolveWithout(const JointProblem& problem, const FreeSet& asked_for,
                                     std::size_t frame, const PoseBlock& pose, Solution solution) {
  HoldFrame(problem, frame, &solution);
  solution.state.poses[frame] = pose;
  solution.observed[frame].Forget();
  return SolveAnew(problem, asked_for, std::move(solution));
}

/// ExcludeDisagreeing for a solution in which all of `asked_for` may be free.
Agreed ExcludeOneByOne(const JointProblem& problem, const FreeSet& asked_for, Solution solution) {
  Agreed agreed{std::move(solution), std::vector<std::optional<ExcludedFrame>>(problem.size()),
                std::vector<Disagreement>(problem.size())};
  std::vector<char> takes_part, settled(problem.size(), 0);  // settled: cannot be solved alone
  for (const char fixed : agreed.solution.fixed) takes_part.push_back(fixed ? 0 : 1);
  for (;;) {
    const CostByFrame cost(problem, agreed.solution, asked_for);
    std::vector<Disagreement> measured(problem.size());
    ParallelFor(problem.size(), problem.setup.threads,
                [&](std::size_t i) { measured[i] = cost.Of(i); });
    ScaleByVarianceFactor(&measured);
    std::optional<std::size_t> worst;
    for (std::size_t i = 0; i < problem.size(); ++i) {
      if (agreed.solution.fixed[i]) continue;
      agreed.measured[i] = measured[i];
      if (settled[i] || !IsOdd(problem, agreed, i)) continue;
      if (!worst || measured[i].cost > measured[*worst].cost) worst = i;
    }
    if (!worst) break;
    if (!LeavesMajority(problem, agreed, takes_part, *worst)) break;
    std::optional<Solution> alone = SolveAlone(problem, asked_for, *worst, agreed.solution);
    std::optional<Solution> without =
        alone
            ? SolveWithout(problem, asked_for, *worst, alone->state.poses[*worst], agreed.solution)
            : std::nullopt;
    if (!without) {
      settled[*worst] = 1;
      continue;
    }
    const QuadraticCost own = CostAround(problem, *alone);
    const Eigen::Index column = problem.layout.Pose(*worst);
    agreed.of[*worst] = ExcludedFrame{
        {agreed.solution.state.poses[*worst].ToPose(), agreed.measured[*worst].Disagrees(),
         FindContradicted(problem, cost, *worst), alone->state.Built(*worst)},
        std::move(alone->state),
        ConditionalPosterior(own.normal, cost.constant, own.prior_sigmas)
            .covariance.block<6, 6>(column, column)};
    agreed.solution = std::move(*without);
  }
  return agreed;
}

}  // namespace

Agreed ExcludeDisagreeing(const JointProblem& problem, const FreeSet& asked_for,
                          Solution solution) {
  const FreeSet tested = WithBuild(problem, asked_for);
  if (tested.boxes == asked_for.boxes && tested.size == asked_for.size)
    return ExcludeOneByOne(problem, asked_for, std::move(solution));
  std::optional<Solution> freed = SolveAnew(problem, tested, solution);
  if (!freed) return ExcludeOneByOne(problem, asked_for, std::move(solution));
  Agreed agreed = ExcludeOneByOne(problem, tested, std::move(*freed));
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!agreed.of[i]) continue;
    std::optional<Solution> without =
        SolveWithout(problem, asked_for, i, agreed.of[i]->alone.poses[i], solution);
    if (without) {
      solution = std::move(*without);
    } else {
      agreed.of[i].reset();
    }
  }
  agreed.solution = std::move(solution);
  return agreed;
}

}  // namespace volalign::refine_internal

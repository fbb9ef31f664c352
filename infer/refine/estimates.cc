#include "infer/refine/estimates.h"
#include "infer/refine/model_choice.h"
#include "infer/refine/tune.h"

#include <algorithm>
#include <array>
#include <functional>
#include <optional>
#include <utility>

#include "core/parallel_for.h"
#include "infer/refine/costs.h"
#include "infer/refine/fine.h"
#include "infer/refine/observations.h"
#include "infer/refine/residuals.h"

namespace volalign::refine_internal {

namespace {

/// A parameter is observable when its posterior standard deviation is below this share of the
/// prior's.
constexpr double kObservable = 0.7;
constexpr double kGaugeOnly = 1e-12;    // m^2, a prior variance that is none: of a single box
constexpr double kUnseenScale = 0.005;  // m, of the robust cost
/// Share of the unseen cost that is its own noise: within it, what the posterior says decides.
constexpr double kCostNoise = 0.03;

double Square(double x) { return x * x; }

/// Clears all flags. Was any set?
bool Clear(std::vector<char>* flags) {
  const bool any = std::any_of(flags->begin(), flags->end(), [](char f) { return f != 0; });
  std::fill(flags->begin(), flags->end(), 0);
  return any;
}

/// Solves again with less free, from where the solution is.
std::optional<Solution> SolveWith(const JointProblem& problem, const FreeSet& free,
                                  Solution solution) {
  solution.free = free;
  problem.layout.SetNominal(free, &solution.state);
  UpdateLineTolerance(problem, solution.state, free, &solution.evidence);
  std::optional<State> solved = SolveFine(problem, solution);
  if (!solved) return std::nullopt;
  solution.state = std::move(*solved);
  return solution;
}

}  // namespace

FreeSet Observable(const NormalEquations& normal, const ParameterLayout& layout,
                   const Structure& structure, const Priors& priors,
                   const std::vector<char>& constant, const Eigen::VectorXd& prior_sigmas,
                   const FreeSet& free) {
  FreeSet kept = free;
  Posterior posterior = ComputePosterior(normal, layout, constant, prior_sigmas);
  const auto observable = [&](Eigen::Index column, double prior) {
    return posterior.Sigma(column) < kObservable * prior;
  };
  kept.size = free.size && observable(layout.Size(), priors.size);
  const Eigen::MatrixXd projection = GaugeProjection(structure, priors);
  const auto boxes = static_cast<int>(layout.boxes());
  const Eigen::VectorXd variances =
      SharedPriorSigmas(priors, 0, boxes).unaryExpr(&Positive).tail(3 * boxes).cwiseAbs2();
  const Eigen::VectorXd prior =
      (projection * variances.asDiagonal() * projection.transpose()).diagonal();
  const Eigen::VectorXd sigmas = BoxSigmas(posterior, layout, projection);
  for (std::size_t b = 0; b < layout.boxes(); ++b) {
    const auto x = static_cast<Eigen::Index>(3 * b);
    for (const Eigen::Index j : {x, x + 1}) {
      // A single box is nothing but gauge.
      const bool clear =
          prior[j] > kGaugeOnly && Square(sigmas[j]) < Square(kObservable) * prior[j];
      kept.boxes[b] = kept.boxes[b] && clear;
    }
  }
  for (std::size_t i = 0; i < layout.sensors(); ++i)
    kept.gain[i] = free.gain[i] && observable(layout.Nuisance(i, kDepthGain), priors.gain);
  // A gain that is held leaves the offset to stand for both at the structure's distance.
  FreeSet without_gain = free;
  without_gain.gain = kept.gain;
  posterior = ConditionalPosterior(normal, layout.Constant(without_gain), prior_sigmas);
  for (std::size_t i = 0; i < layout.sensors(); ++i)
    kept.offset[i] = free.offset[i] && observable(layout.Offset(i), priors.offset);
  return kept;
}

std::vector<SensorEvidence> GatherUnseen(const JointProblem& problem, const State& state) {
  std::vector<SensorEvidence> unseen(problem.size());
  ParallelFor(problem.size(), problem.options.threads, [&](std::size_t i) {
    if (!problem.HasStructureTerms(i)) return;
    GatherObservations(problem.structure, state, i, *problem.sensors[i].points, BlockUse::kChoose,
                       {state.poses[i].ToPose()}, FineGates(), &unseen[i]);
  });
  return unseen;
}

double UnseenCost(const JointProblem& problem, const State& state,
                  const std::vector<SensorEvidence>& unseen) {
  double sum = 0;
  int count = 0;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!problem.HasStructureTerms(i)) continue;
    Eigen::VectorXd r;
    Residuals(problem.model, unseen[i], state.Parameters(i), &r, nullptr);
    for (const double distance : r) sum += RobustCost(distance, kUnseenScale);
    count += static_cast<int>(r.size());
  }
  return count > 0 ? sum / count : 0;
}

Solution ChooseEstimates(const JointProblem& problem, Solution solution) {
  const std::vector<SensorEvidence> unseen = GatherUnseen(problem, solution.state);
  const NormalEquations normal = ComputeNormalEquations(problem, solution);
  const FreeSet observable = Observable(normal, problem.layout, problem.structure, problem.priors,
                                        problem.layout.Constant(solution.free),
                                        PriorSigmas(problem, solution.evidence), solution.free);
  std::optional<Solution> kept = SolveWith(problem, observable, solution);
  if (!kept) return solution;
  solution = std::move(*kept);

  if (Tune("VB_OLD", 0) > 0) {
  const std::array<std::function<bool(FreeSet*)>, 4> kinds = {
      [](FreeSet* f) { return Clear(&f->boxes); },
      [](FreeSet* f) { return std::exchange(f->size, false); },
      [](FreeSet* f) { return Clear(&f->gain); }, [](FreeSet* f) { return Clear(&f->offset); }};
  for (const auto& drop : kinds) {
    FreeSet less = solution.free;
    if (!drop(&less)) continue;
    const double cost = UnseenCost(problem, solution.state, unseen);
    std::optional<Solution> without = SolveWith(problem, less, solution);
    if (without && UnseenCost(problem, without->state, unseen) < (1 - kCostNoise) * cost) {
      solution = std::move(*without);
    } else {
      UpdateLineTolerance(problem, solution.state, solution.free, &solution.evidence);
    }
  }
  return solution;
  }
  const NormalEquations kept_normal = ComputeNormalEquations(problem, solution);
  const PriorScales scales = MostProbableScales(
      {kept_normal.information, kept_normal.gradient, problem.layout.Values(solution.state),
       PriorSigmas(problem, solution.evidence)},
      problem.layout, solution.free);
  const double line_free = solution.free.AllBoxes();
  (void)line_free;
  solution.state.scales = scales;
  if (scales.boxes == 0) Clear(&solution.free.boxes);
  if (scales.size == 0) solution.free.size = false;
  if (scales.gain == 0) Clear(&solution.free.gain);
  if (scales.offset == 0) Clear(&solution.free.offset);
  problem.layout.SetNominal(solution.free, &solution.state);
  if (std::optional<State> solved = SolveFine(problem, solution)) solution.state = std::move(*solved);
  return solution;
}

}  // namespace volalign::refine_internal

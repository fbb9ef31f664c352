#include "infer/refine/estimates.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "infer/refine/model_choice.h"

namespace volalign::refine_internal {

namespace {

/// A parameter is observable when its posterior standard deviation is below this share of the
/// prior's: when a capture says more of it than the prior does.
constexpr double kObservable = M_SQRT1_2;

void Clear(std::vector<char>* flags) { std::fill(flags->begin(), flags->end(), 0); }

/// Solves again with less free, from where the solution is.
std::optional<Solution> SolveWith(const JointProblem& problem, const FreeSet& free,
                                  Solution solution) {
  solution.free = free;
  problem.layout.SetNominal(free, &solution.state);
  UpdateLineTolerance(problem, &solution);
  if (!Solve(problem, &solution)) return std::nullopt;
  return solution;
}

FreeSet Told(const JointProblem& problem, const Solution& solution) {
  const QuadraticCost cost = CostAround(problem, solution);
  return Observable(cost.normal, problem.layout, problem.structure, problem.priors,
                    solution.state.lenses, problem.layout.Constant(solution.free),
                    cost.prior_sigmas, solution.free);
}

}  // namespace

FreeSet Observable(const NormalEquations& normal, const ParameterLayout& layout,
                   const Structure& structure, const Priors& priors,
                   const std::vector<LensChange>& lenses, const std::vector<char>& constant,
                   const Eigen::VectorXd& prior_sigmas, const FreeSet& free) {
  FreeSet kept = free;
  Posterior posterior = ComputePosterior(normal, constant, prior_sigmas);
  const auto observable = [&](Eigen::Index column, double prior) {
    return posterior.Sigma(column) < kObservable * prior;
  };
  kept.size = free.size && observable(layout.Size(), priors.size);
  for (std::size_t lens = 0; lens < layout.lenses(); ++lens) {
    const Eigen::Index column = layout.Lens(lens);
    const LensEstimate estimate{
        lenses[lens], posterior.covariance.block<kLensParameters, kLensParameters>(column, column)};
    kept.lens[lens] =
        free.lens[lens] &&
        LogBayesFactor(estimate, prior_sigmas.segment<kLensParameters>(column)) > kBelievedLens;
  }
  const Eigen::MatrixXd projection = GaugeProjection(structure, priors);
  const int boxes = static_cast<int>(layout.boxes());
  const Eigen::VectorXd variances =
      SharedPriorSigmas(priors, {}, {boxes, 0}).unaryExpr(&Positive).tail(3 * boxes).cwiseAbs2();
  const Eigen::VectorXd prior =
      (projection * variances.asDiagonal() * projection.transpose()).diagonal();
  for (std::size_t still = 0; still < layout.stills(); ++still) {
    const Eigen::VectorXd sigmas = BoxSigmas(posterior, layout, still, projection);
    for (std::size_t b = 0; b < layout.boxes(); ++b) {
      char& keep = kept.boxes[still * layout.boxes() + b];
      const auto x = static_cast<Eigen::Index>(3 * b);
      for (const Eigen::Index j : {x, x + 1}) {
        // A single box is nothing but gauge.
        keep = keep && prior[j] > Square(Positive(0)) &&
               Square(sigmas[j]) < Square(kObservable) * prior[j];
      }
    }
  }
  for (std::size_t i = 0; i < layout.frames(); ++i)
    kept.gain[i] = free.gain[i] && observable(layout.Gain(i), prior_sigmas[layout.Gain(i)]);
  // A gain that is held leaves the offset to stand for both at the structure's distance.
  FreeSet without_gain = free;
  without_gain.gain = kept.gain;
  posterior = ConditionalPosterior(normal, layout.Constant(without_gain), prior_sigmas);
  for (std::size_t i = 0; i < layout.frames(); ++i)
    kept.offset[i] = free.offset[i] && observable(layout.Offset(i), priors.offset);
  return kept;
}

Solution ChooseEstimates(const JointProblem& problem, Solution solution) {
  const std::optional<EstimateChoice>& earlier = problem.setup.choice;
  const FreeSet told = earlier ? earlier->told : Told(problem, solution);
  std::optional<Solution> kept = SolveWith(problem, told, solution);
  if (!kept) return solution;
  const std::optional<PriorScales> scales =
      earlier ? earlier->scales
              : MostProbableScales(CostAround(problem, *kept), problem.layout, told,
                                   problem.setup.schedule.threads);
  if (!scales) return *kept;

  // The tolerance of edges stays: boxes that are found where the structure has them have their
  // edges there too.
  Solution chosen = *kept;
  chosen.choice = EstimateChoice{told, *scales};
  chosen.state.scales = *scales;
  if (scales->places == 0 && scales->turns == 0) Clear(&chosen.free.boxes);
  if (scales->size == 0) chosen.free.size = false;
  if (scales->gain == 0) Clear(&chosen.free.gain);
  if (scales->offset == 0) Clear(&chosen.free.offset);
  problem.layout.SetNominal(chosen.free, &chosen.state);
  if (!Solve(problem, &chosen)) return *kept;
  return chosen;
}

}  // namespace volalign::refine_internal

#include "infer/refine/refine.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/error.h"
#include "infer/refine/acceptance.h"
#include "infer/refine/coarse.h"
#include "infer/refine/disagreement.h"
#include "infer/refine/estimates.h"
#include "infer/refine/fine.h"
#include "infer/refine/model_choice.h"
#include "infer/refine/posterior.h"

namespace volalign {

namespace {

using namespace refine_internal;  // NOLINT(google-build-using-namespace): its own parts

/// Where everything begins. A sensor that has no place to begin at is kept at its fallback.
Solution Begin(const JointProblem& problem, const FreeSet& asked_for) {
  std::vector<Pose> starts;
  for (const RefineSensor& sensor : problem.sensors) starts.push_back(sensor.start);
  Solution solution{asked_for,
                    NominalState(problem.structure, starts, problem.lenses, problem.lens_of),
                    {},
                    std::vector<char>(problem.size(), 0)};
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!starts[i].matrix().allFinite()) KeepInitial(problem, i, &solution);
  }
  return solution;
}

void CheckPoses(const std::vector<RefineSensor>& sensors) {
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    if (sensors[i].to_beat.matrix().allFinite() && sensors[i].fallback.matrix().allFinite())
      continue;
    throw DataError(fmt::format(
        "sensor {} has no finite pose to fall back to or to beat; give both, or leave it out", i));
  }
}

/// Gauge: the mean displacement of the estimated boxes is zero. The priors all but see to it.
void CentreBoxes(const JointProblem& problem, Solution* solution) {
  const FreeSet& free = solution->free;
  State* state = &solution->state;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  std::vector<int> estimated;
  for (std::size_t b = 0; b < free.boxes.size(); ++b) {
    if (free.boxes[b]) estimated.push_back(static_cast<int>(b));
  }
  if (estimated.empty()) return;
  const auto at = [&](int k) -> double& { return state->build[static_cast<std::size_t>(k)]; };
  for (const int b : estimated)
    mean += Eigen::Vector3d(at(BuildModel::X(b)), 0, at(BuildModel::Z(b)));
  mean /= static_cast<double>(estimated.size());
  for (const int b : estimated) {
    at(BuildModel::X(b)) -= mean.x();
    at(BuildModel::Z(b)) -= mean.z();
  }
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!solution->kept_initial[i]) Eigen::Map<Eigen::Vector3d>(state->poses[i].values + 4) -= mean;
  }
  state->built = problem.model.Built(state->build.data());
}

/// What there is to say of numbers that failed, or nothing.
std::string Problem(bool unsolved, bool exact_covariance) {
  if (unsolved)
    return "its refinement could not be solved: its measurements give numbers that are not finite";
  if (!exact_covariance)
    return "the uncertainty could not be computed: what nothing tells is given as the prior has it";
  return "";
}

RefinedSensor SensorResult(const JointProblem& problem, const Acceptance& accepted,
                           const std::vector<char>& unsolved, const Posterior& posterior,
                           const std::optional<SetAside>& set_aside, std::size_t i) {
  const auto& [free, state, evidence, kept_initial] = accepted.solution;
  const ParameterLayout& layout = problem.layout;
  RefinedSensor sensor;
  sensor.accepted = !kept_initial[i];
  sensor.structure_from_sensor =
      sensor.accepted ? state.poses[i].ToPose() : problem.sensors[i].fallback;
  if (free.offset[i] && sensor.accepted) sensor.depth_offset = state.offsets[i];
  if (free.gain[i] && sensor.accepted) sensor.depth_gain = 1 + state.nuisances[i][kDepthGain];
  sensor.sigma_depth_offset = posterior.Sigma(layout.Offset(i));
  sensor.sigma_depth_gain = posterior.Sigma(layout.Nuisance(i, kDepthGain));
  sensor.held_out_before = accepted.before[i].misfit;
  sensor.held_out_after = accepted.after[i].misfit;
  const Matrix6d block = posterior.covariance.block<6, 6>(layout.Pose(i), layout.Pose(i));
  sensor.covariance =
      (block + block.transpose()) / 2 + accepted.refused[i] * accepted.refused[i].transpose();
  sensor.problem = Problem(unsolved[i], posterior.exact);
  if (set_aside) {
    sensor.accepted = true;
    sensor.covariance = set_aside->disagreement.covariance;
    sensor.structure_from_sensor = problem.sensors[i].start;
    sensor.refused_fit = RefusedFit{set_aside->together, set_aside->disagreement.rms_together,
                                    set_aside->disagreement.rms_alone};
  }
  return sensor;
}

/// Does a sensor that was refined see the box?
bool IsSeen(const JointProblem& problem, const Acceptance& accepted, int box) {
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (accepted.solution.kept_initial[i]) continue;
    for (const FaceObservation& face : accepted.solution.evidence[i].faces) {
      if (problem.structure.SideOfLabel(face.label).box == box) return true;
    }
  }
  return false;
}

std::vector<RefinedBox> BoxResults(const JointProblem& problem, const Acceptance& accepted,
                                   const Posterior& posterior) {
  const Eigen::VectorXd sigmas =
      BoxSigmas(posterior, problem.layout, GaugeProjection(problem.structure, problem.priors));
  const std::vector<double>& build = accepted.solution.state.build;
  std::vector<RefinedBox> boxes;
  for (int b = 0; b < static_cast<int>(problem.structure.boxes().size()); ++b) {
    RefinedBox box;
    box.estimated =
        accepted.solution.free.boxes[static_cast<std::size_t>(b)] && IsSeen(problem, accepted, b);
    box.x = build[static_cast<std::size_t>(BuildModel::X(b))];
    box.z = build[static_cast<std::size_t>(BuildModel::Z(b))];
    box.yaw = build[static_cast<std::size_t>(BuildModel::Yaw(b))];
    box.sigma_x = sigmas[Eigen::Index{3} * b];
    box.sigma_z = sigmas[Eigen::Index{3} * b + 1];
    box.sigma_yaw = sigmas[Eigen::Index{3} * b + 2];
    boxes.push_back(box);
  }
  return boxes;
}

std::vector<RefinedPair> PairResults(const JointProblem& problem, const State& state) {
  const Gates gates = FineGates();
  std::vector<OverlapView> views;
  for (std::size_t i = 0; i < problem.size(); ++i) views.push_back(problem.Overlap(i, state));
  std::vector<RefinedPair> pairs;
  for (const Pair& pair :
       FindPairs(views, gates.overlap, gates.min_cosine, problem.options.min_overlap))
    pairs.push_back({pair.a, pair.b, pair.overlap, pair.rms});
  return pairs;
}

RefineResult MakeResult(const JointProblem& problem, const Acceptance& accepted,
                        const std::vector<char>& unsolved, const Posterior& posterior,
                        const std::vector<std::optional<SetAside>>& set_aside,
                        std::size_t given_lenses) {
  const auto& [free, state, evidence, kept_initial] = accepted.solution;
  RefineResult result;
  for (std::size_t i = 0; i < problem.size(); ++i)
    result.sensors.push_back(SensorResult(problem, accepted, unsolved, posterior, set_aside[i], i));
  result.boxes = BoxResults(problem, accepted, posterior);
  result.size_estimated =
      free.size && std::any_of(result.sensors.begin(), result.sensors.end(),
                               [](const RefinedSensor& sensor) { return sensor.accepted; });
  result.size_scale = 1 + state.build[0];
  result.sigma_size_scale = posterior.Sigma(problem.layout.Size());
  result.built = state.built;
  result.pairs = PairResults(problem, state);
  for (std::size_t lens = 0; lens < given_lenses; ++lens) {
    const Eigen::Index column = problem.layout.Lens(lens);
    result.lenses.push_back(
        {state.lenses[lens],
         free.lens[lens] != 0,
         {posterior.Sigma(column), posterior.Sigma(column + 1), posterior.Sigma(column + 2)}});
  }
  return result;
}

/// Of everything. Where it is to be found out what strays from its nominal value, the uncertainty
/// of that is part of it.
Posterior PosteriorOf(const JointProblem& problem, const Solution& solution,
                      const FreeSet& asked_for) {
  const QuadraticCost cost = CostAround(problem, solution);
  Posterior posterior = ComputePosterior(cost.normal, problem.layout,
                                         problem.layout.Constant(asked_for), cost.prior_sigmas);
  if (!problem.options.choose_estimates || !posterior.exact) return posterior;
  const Eigen::MatrixXd covariance = CovarianceOverModels(cost, problem.layout);
  if (covariance.size() > 0 && covariance.allFinite()) posterior.covariance = covariance;
  return posterior;
}

}  // namespace

std::vector<std::string> UnconstrainedDirections(const Matrix6d& covariance) {
  constexpr double kOpenTranslation = 0.03, kOpenRotation = 2 * M_PI / 180;
  std::vector<std::string> names;
  for (const bool rotation : {false, true}) {
    const Eigen::Matrix3d part =
        rotation ? covariance.bottomRightCorner<3, 3>() : covariance.topLeftCorner<3, 3>();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(part);
    for (int k = 2; k >= 0; --k) {
      const double sigma = std::sqrt(std::max(solver.eigenvalues()[k], 0.0));
      if (!(sigma > (rotation ? kOpenRotation : kOpenTranslation))) continue;
      Eigen::Vector3d axis = solver.eigenvectors().col(k);
      Eigen::Index main = 0;
      axis.cwiseAbs().maxCoeff(&main);
      if (axis[main] < 0) axis = -axis;
      constexpr double kAligned = 0.94;  // cos 20 deg
      std::string name = main == 1 ? "the vertical" : main == 0 ? "structure x" : "structure z";
      if (axis[main] < kAligned)
        name = fmt::format("structure ({:.2f}, {:.2f}, {:.2f})", axis.x(), axis.y(), axis.z());
      names.push_back(rotation ? fmt::format("about {} ({:.1f} deg)", name, sigma * 180 / M_PI)
                               : fmt::format("along {} ({:.2f} m)", name, sigma));
    }
  }
  return names;
}

RefineResult Refine(const Structure& structure, const std::vector<RefineSensor>& sensors,
                    const RefineOptions& options, const std::vector<SensorLens>& lenses) {
  const EstimateSet asked = ParseEstimate(options.estimate);
  if (sensors.empty()) {
    RefineResult nothing;
    nothing.boxes.resize(structure.boxes().size());
    nothing.built = structure;
    for (const SensorLens& lens : lenses) nothing.lenses.push_back({lens.change});
    return nothing;
  }
  CheckPoses(sensors);
  const JointProblem problem(structure, sensors, options, lenses);
  const FreeSet asked_for =
      AskedFor(asked, problem.priors, sensors.size(), structure.boxes().size(), problem.lenses);

  Solution solution = Begin(problem, asked_for);
  if (options.coarse) {
    solution.state = SolveCoarse(problem, solution.kept_initial, std::move(solution.state));
  }
  solution = IterateFine(problem, std::move(solution));
  const std::vector<char> unsolved = solution.kept_initial;
  Agreed agreed{std::move(solution), std::vector<std::optional<SetAside>>(sensors.size())};
  if (options.choose_estimates) {
    agreed = SetAsideDisagreeing(problem, asked_for,
                                 ChooseEstimates(problem, std::move(agreed.solution)));
  }
  Acceptance accepted = AcceptImproved(problem, std::move(agreed.solution));
  CentreBoxes(problem, &accepted.solution);
  const Posterior posterior = PosteriorOf(problem, accepted.solution, asked_for);
  return MakeResult(problem, accepted, unsolved, posterior, agreed.of, lenses.size());
}

}  // namespace volalign

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
Solution Begin(const JointProblem& problem, const std::vector<Pose>& placements,
               const FreeSet& asked_for) {
  std::vector<Pose> starts;
  for (const RefineSensor& sensor : problem.sensors) starts.push_back(sensor.start);
  Solution solution{
      asked_for,
      NominalState(problem.structure, starts, problem.lenses, problem.frames, placements),
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

/// Makes the mean displacement of a still's estimated boxes zero. Returns it.
Eigen::Vector3d TakeMeanOut(const char* estimated, std::vector<double>* boxes) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double count = 0;
  const auto at = [&](int k) -> double& { return (*boxes)[static_cast<std::size_t>(k)]; };
  const int all = static_cast<int>(boxes->size()) / 3;
  for (int b = 0; b < all; ++b) {
    if (!estimated[b]) continue;
    mean += Eigen::Vector3d(at(BuildModel::X(b)), 0, at(BuildModel::Z(b)));
    ++count;
  }
  mean /= std::max(1.0, count);
  for (int b = 0; b < all; ++b) {
    if (!estimated[b]) continue;
    at(BuildModel::X(b)) -= mean.x();
    at(BuildModel::Z(b)) -= mean.z();
  }
  return mean;
}

/// Gauge: in each still, the mean displacement of the estimated boxes is zero. The priors all but
/// see to it.
void CentreBoxes(const JointProblem& problem, Solution* solution) {
  State* state = &solution->state;
  std::vector<Eigen::Vector3d> means;
  for (std::size_t still = 0; still < state->boxes.size(); ++still) {
    means.push_back(TakeMeanOut(solution->free.boxes.data() + still * problem.layout.boxes(),
                                &state->boxes[still]));
  }
  for (std::size_t still = 1; still < means.size(); ++still) {
    Pose placement = state->placements[still].ToPose();
    placement.translation() += placement.linear() * means[still] - means[0];
    state->placements[still] = PoseBlock(placement);
  }
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (solution->kept_initial[i]) continue;
    Eigen::Map<Eigen::Vector3d>(state->poses[i].values + 4) -= means[state->StillOf(i)];
  }
  state->UpdateBuilt(problem.model);
}

/// What there is to say of numbers that failed, or nothing.
std::string Problem(bool unsolved, bool exact_covariance) {
  if (unsolved)
    return "its refinement could not be solved: its measurements give numbers that are not finite";
  if (!exact_covariance)
    return "the uncertainty could not be computed: what nothing tells is given as the prior has it";
  return "";
}

/// T Exp(delta) = Exp(Adjoint(T) delta) T, for delta = [translation; rotation vector].
Matrix6d Adjoint(const Pose& pose) {
  Matrix6d adjoint = Matrix6d::Zero();
  adjoint.topLeftCorner<3, 3>() = adjoint.bottomRightCorner<3, 3>() = pose.linear();
  adjoint.topRightCorner<3, 3>() = Cross(pose.translation()) * pose.linear();
  return adjoint;
}

/// Of first_from_placement * pose, pose being a frame's.
Matrix6d CovarianceInFirst(const JointProblem& problem, const Posterior& posterior,
                           const Pose& placement, std::size_t frame, const Matrix6d& covariance) {
  const Matrix6d turned = Adjoint(placement);
  Matrix6d in_first = turned * covariance * turned.transpose();
  const auto still = static_cast<std::size_t>(problem.frames[frame].still);
  if (still == 0) return in_first;
  const Eigen::Index p = problem.layout.Placement(still), t = problem.layout.Pose(frame);
  const Matrix6d cross = posterior.covariance.block<6, 6>(p, t) * turned.transpose();
  in_first += posterior.covariance.block<6, 6>(p, p) + cross + cross.transpose();
  return (in_first + in_first.transpose()) / 2;
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
  const std::size_t own = state.SensorOf(i);
  if (free.offset[i] && sensor.accepted) sensor.depth_offset = state.offsets[own];
  if (free.gain[i] && sensor.accepted) sensor.depth_gain = 1 + state.nuisances[own][kDepthGain];
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
  const Pose placement = state.placements[state.StillOf(i)].ToPose();
  sensor.first_from_sensor = placement * sensor.structure_from_sensor;
  sensor.first_covariance = CovarianceInFirst(problem, posterior, placement, i, sensor.covariance);
  return sensor;
}

/// Does a sensor that was refined see the box in a still?
bool IsSeen(const JointProblem& problem, const Acceptance& accepted, std::size_t still, int box) {
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (accepted.solution.kept_initial[i] || accepted.solution.state.StillOf(i) != still) continue;
    for (const FaceObservation& face : accepted.solution.evidence[i].faces) {
      if (problem.structure.SideOfLabel(face.label).box == box) return true;
    }
  }
  return false;
}

std::vector<RefinedBox> BoxResults(const JointProblem& problem, const Acceptance& accepted,
                                   const Posterior& posterior, std::size_t still) {
  const Eigen::VectorXd sigmas = BoxSigmas(posterior, problem.layout, still,
                                           GaugeProjection(problem.structure, problem.priors));
  const std::vector<double>& of_boxes = accepted.solution.state.boxes[still];
  const char* free = accepted.solution.free.boxes.data() + still * problem.layout.boxes();
  std::vector<RefinedBox> boxes;
  for (int b = 0; b < static_cast<int>(problem.structure.boxes().size()); ++b) {
    RefinedBox box;
    box.estimated = free[b] && IsSeen(problem, accepted, still, b);
    box.x = of_boxes[static_cast<std::size_t>(BuildModel::X(b))];
    box.z = of_boxes[static_cast<std::size_t>(BuildModel::Z(b))];
    box.yaw = of_boxes[static_cast<std::size_t>(BuildModel::Yaw(b))];
    box.sigma_x = sigmas[Eigen::Index{3} * b];
    box.sigma_z = sigmas[Eigen::Index{3} * b + 1];
    box.sigma_yaw = sigmas[Eigen::Index{3} * b + 2];
    boxes.push_back(box);
  }
  return boxes;
}

/// Still by still.
std::vector<RefinedPair> PairResults(const JointProblem& problem, const State& state) {
  const Gates gates = FineGates();
  std::vector<RefinedPair> pairs;
  for (std::size_t still = 0; still < problem.layout.stills(); ++still) {
    std::vector<OverlapView> views;
    std::vector<int> frames;  // of each view
    for (std::size_t i = 0; i < problem.size(); ++i) {
      if (state.StillOf(i) != still) continue;
      views.push_back(problem.Overlap(i, state));
      frames.push_back(static_cast<int>(i));
    }
    for (const Pair& pair :
         FindPairs(views, gates.overlap, gates.min_cosine, problem.options.min_overlap)) {
      pairs.push_back({frames[static_cast<std::size_t>(pair.a)],
                       frames[static_cast<std::size_t>(pair.b)], pair.overlap, pair.rms});
    }
  }
  return pairs;
}

std::vector<RefinedPlacement> PlacementResults(const JointProblem& problem,
                                               const Acceptance& accepted,
                                               const Posterior& posterior) {
  const State& state = accepted.solution.state;
  std::vector<RefinedPlacement> placements;
  for (std::size_t still = 0; still < problem.layout.stills(); ++still) {
    RefinedPlacement placement;
    placement.first_from_placement = state.placements[still].ToPose();
    if (still > 0) {
      const Eigen::Index column = problem.layout.Placement(still);
      placement.covariance = posterior.covariance.block<6, 6>(column, column);
    }
    placement.boxes = BoxResults(problem, accepted, posterior, still);
    placement.built = state.built[still];
    placements.push_back(std::move(placement));
  }
  return placements;
}

RefineResult MakeResult(const JointProblem& problem, const Acceptance& accepted,
                        const std::vector<char>& unsolved, const Posterior& posterior,
                        const std::vector<std::optional<SetAside>>& set_aside,
                        std::size_t given_lenses) {
  const auto& [free, state, evidence, kept_initial] = accepted.solution;
  RefineResult result;
  for (std::size_t i = 0; i < problem.size(); ++i)
    result.sensors.push_back(SensorResult(problem, accepted, unsolved, posterior, set_aside[i], i));
  result.placements = PlacementResults(problem, accepted, posterior);
  result.size_estimated =
      free.size && std::any_of(result.sensors.begin(), result.sensors.end(),
                               [](const RefinedSensor& sensor) { return sensor.accepted; });
  result.size_scale = 1 + state.size;
  result.sigma_size_scale = posterior.Sigma(problem.layout.Size());
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
                    const RefineOptions& options, const std::vector<SensorLens>& lenses,
                    const std::vector<Pose>& placements) {
  const EstimateSet asked = ParseEstimate(options.estimate);
  if (sensors.empty()) {
    RefineResult nothing;
    for (const Pose& placement : placements) {
      nothing.placements.push_back({placement, Matrix6d::Zero(),
                                    std::vector<RefinedBox>(structure.boxes().size()), structure});
    }
    for (const SensorLens& lens : lenses) nothing.lenses.push_back({lens.change});
    return nothing;
  }
  CheckPoses(sensors);
  const JointProblem problem(structure, sensors, options, lenses, placements.size());
  const FreeSet asked_for = AskedFor(asked, problem.priors, sensors.size(),
                                     placements.size() * structure.boxes().size(), problem.lenses);

  Solution solution = Begin(problem, placements, asked_for);
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

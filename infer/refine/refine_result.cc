#include "infer/refine/refine_result.h"

#include <algorithm>
#include <string>
#include <utility>

#include "core/base/parallel_for.h"
#include "infer/refine/association.h"
#include "infer/refine/solution.h"

namespace volalign::refine_internal {

namespace {

/// What there is to say of numbers that failed, or nothing.
std::string Problem(bool unsolved, bool exact_covariance) {
  if (unsolved)
    return "its refinement could not be solved: its measurements give numbers that are not finite";
  if (!exact_covariance)
    return "the uncertainty could not be computed: what nothing tells is given as the prior has it";
  return "";
}

/// Of first_from_placement * pose, pose being a frame's.
Matrix6d CovarianceInFirst(const JointProblem& problem, const Posterior& posterior,
                           const Pose& placement, std::size_t frame, const Matrix6d& covariance) {
  const Matrix6d turned = Adjoint(placement);
  Matrix6d in_first = turned * covariance * turned.transpose();
  const auto still = static_cast<std::size_t>(problem.frame_of[frame].still);
  if (still == 0) return in_first;
  const Eigen::Index p = problem.layout.Placement(still), t = problem.layout.Pose(frame);
  const Matrix6d cross = posterior.covariance.block<6, 6>(p, t) * turned.transpose();
  in_first += posterior.covariance.block<6, 6>(p, p) + cross + cross.transpose();
  return (in_first + in_first.transpose()) / 2;
}

RefinedFrame RefinedFrameOf(const JointProblem& problem, const Acceptance& accepted,
                            const Agreed& agreed, std::size_t i) {
  const auto& [free, state, observed, held, choice, overlaps] = accepted.solution;
  RefinedFrame frame;
  frame.accepted = !held[i];
  frame.structure_from_sensor =
      frame.accepted ? state.poses[i].ToPose() : problem.frames[i].fallback;
  if (free.offset[i] && frame.accepted) frame.depth_offset = state.offsets[i];
  if (free.gain[i] && frame.accepted) frame.depth_gain = 1 + state.gains[state.SensorOf(i)];
  if (free.lens[state.LensOf(i)] && frame.accepted)
    frame.own_focal = state.focals[state.SensorOf(i)];
  frame.noise = observed[i].noise;
  frame.disagreement = agreed.measured[i].cost;
  frame.rms_together = agreed.measured[i].rms_together;
  frame.rms_alone = agreed.measured[i].rms_alone;
  if (const std::optional<SetAside>& set_aside = agreed.of[i]) {
    frame.accepted = true;
    frame.structure_from_sensor = set_aside->alone.poses[i].ToPose();
    frame.depth_offset = set_aside->alone.offsets[i];
    frame.depth_gain = 1 + set_aside->alone.gains[state.SensorOf(i)];
    frame.own_focal = set_aside->alone.focals[state.SensorOf(i)];
    frame.refused_fit =
        RefusedFit{set_aside->together, set_aside->contradicts, set_aside->alone.Built(i)};
  }
  frame.first_from_sensor =
      state.placements[state.StillOf(i)].ToPose() * frame.structure_from_sensor;
  return frame;
}

void AddUncertainty(const JointProblem& problem, const Acceptance& accepted,
                    const std::vector<char>& unsolved, const Posterior& posterior,
                    const Agreed& agreed, std::size_t i, RefinedFrame* frame) {
  const ParameterLayout& layout = problem.layout;
  const State& state = accepted.solution.state;
  frame->sigma_depth_offset = posterior.Sigma(layout.Offset(i));
  frame->sigma_depth_gain = posterior.Sigma(layout.Gain(i));
  const Matrix6d block = posterior.covariance.block<6, 6>(layout.Pose(i), layout.Pose(i));
  frame->covariance =
      (block + block.transpose()) / 2 + accepted.refused[i] * accepted.refused[i].transpose();
  if (agreed.of[i]) frame->covariance = agreed.measured[i].covariance;
  frame->problem = Problem(unsolved[i], posterior.exact);
  frame->first_covariance = CovarianceInFirst(
      problem, posterior, state.placements[state.StillOf(i)].ToPose(), i, frame->covariance);
}

std::vector<RefinedBox> BoxResults(const JointProblem& problem, const Acceptance& accepted,
                                   std::size_t still) {
  const std::vector<double>& of_boxes = accepted.solution.state.boxes[still];
  const char* free = accepted.solution.free.boxes.data() + still * problem.layout.boxes();
  std::vector<RefinedBox> boxes;
  for (int b = 0; b < static_cast<int>(problem.structure.boxes().size()); ++b) {
    RefinedBox box;
    box.estimated = free[b] && IsSeen(problem, accepted.solution, still, b);
    box.x = of_boxes[static_cast<std::size_t>(BuildModel::X(b))];
    box.z = of_boxes[static_cast<std::size_t>(BuildModel::Z(b))];
    box.yaw = of_boxes[static_cast<std::size_t>(BuildModel::Yaw(b))];
    boxes.push_back(box);
  }
  return boxes;
}

void AddUncertainty(const JointProblem& problem, const Posterior& posterior, std::size_t still,
                    RefinedPlacement* placement) {
  if (still > 0) {
    const Eigen::Index column = problem.layout.Placement(still);
    placement->covariance = posterior.covariance.block<6, 6>(column, column);
  }
  const Eigen::VectorXd sigmas = BoxSigmas(posterior, problem.layout, still,
                                           GaugeProjection(problem.structure, problem.priors));
  for (std::size_t b = 0; b < placement->boxes.size(); ++b) {
    RefinedBox& box = placement->boxes[b];
    const auto first = static_cast<Eigen::Index>(3 * b);
    box.sigma_x = sigmas[first];
    box.sigma_z = sigmas[first + 1];
    box.sigma_yaw = sigmas[first + 2];
  }
}

std::vector<RefinedPair> PairResults(const JointProblem& problem, const State& state) {
  const Gates gates;
  std::vector<std::vector<RefinedPair>> of_first(problem.size());
  ParallelFor(problem.size(), problem.setup.schedule.threads, [&](std::size_t a) {
    for (std::size_t b = a + 1; b < problem.size(); ++b) {
      if (state.StillOf(a) != state.StillOf(b)) continue;
      const SharedPoints shared = FindShared(problem.Overlap(a, state), problem.Overlap(b, state),
                                             gates.overlap, gates.min_cosine);
      if (!shared.IsPair(problem.setup.schedule.min_overlap)) continue;
      of_first[a].push_back(
          {static_cast<int>(a), static_cast<int>(b), shared.overlap, shared.rms()});
    }
  });
  std::vector<RefinedPair> pairs;
  for (const std::vector<RefinedPair>& some : of_first)
    pairs.insert(pairs.end(), some.begin(), some.end());
  return pairs;
}

/// Errors of frames that are not of the joint solution are independent of the others'.
Matrix6d CovarianceBetween(const JointProblem& problem, const Acceptance& accepted,
                           const Posterior& posterior, const Agreed& agreed,
                           const RefineResult& result, const RefinedPair& pair) {
  const auto a = static_cast<std::size_t>(pair.a), b = static_cast<std::size_t>(pair.b);
  Matrix6d between = result.frames[a].covariance + result.frames[b].covariance;
  const std::vector<char>& held = accepted.solution.held;
  if (held[a] || held[b] || agreed.of[a] || agreed.of[b]) return between;
  const Matrix6d cross =
      posterior.covariance.block<6, 6>(problem.layout.Pose(a), problem.layout.Pose(b));
  between -= cross + cross.transpose();
  return between;
}

std::vector<RefinedPlacement> PlacementResults(const JointProblem& problem,
                                               const Acceptance& accepted) {
  const State& state = accepted.solution.state;
  std::vector<RefinedPlacement> placements;
  for (std::size_t still = 0; still < problem.layout.stills(); ++still) {
    RefinedPlacement placement;
    placement.first_from_placement = state.placements[still].ToPose();
    placement.boxes = BoxResults(problem, accepted, still);
    placement.built = state.built[still];
    placements.push_back(std::move(placement));
  }
  return placements;
}

}  // namespace

RefineResult MakeResult(const JointProblem& problem, const Acceptance& accepted,
                        const Agreed& agreed, std::size_t given_lenses) {
  const auto& [free, state, observed, held, choice, overlaps] = accepted.solution;
  RefineResult result;
  for (std::size_t i = 0; i < problem.size(); ++i)
    result.frames.push_back(RefinedFrameOf(problem, accepted, agreed, i));
  result.placements = PlacementResults(problem, accepted);
  result.size_estimated =
      free.size && std::any_of(result.frames.begin(), result.frames.end(),
                               [](const RefinedFrame& frame) { return frame.accepted; });
  result.size_scale = 1 + state.size;
  result.choice = choice;
  result.converged = state.converged;
  for (std::size_t lens = 0; lens < given_lenses; ++lens)
    result.lenses.push_back({state.lenses[lens], free.lens[lens] != 0});
  return result;
}

void AddUncertainties(const JointProblem& problem, const Acceptance& accepted,
                      const std::vector<char>& unsolved, const Posterior& posterior,
                      const Agreed& agreed, RefineResult* result) {
  for (std::size_t i = 0; i < problem.size(); ++i)
    AddUncertainty(problem, accepted, unsolved, posterior, agreed, i, &result->frames[i]);
  for (std::size_t still = 0; still < result->placements.size(); ++still)
    AddUncertainty(problem, posterior, still, &result->placements[still]);
  result->sigma_size_scale = posterior.Sigma(problem.layout.Size());
  for (std::size_t lens = 0; lens < result->lenses.size(); ++lens) {
    const Eigen::Index column = problem.layout.Lens(lens);
    result->lenses[lens].sigmas << posterior.Sigma(column), posterior.Sigma(column + 1),
        posterior.Sigma(column + 2);
  }
  result->pairs = PairResults(problem, accepted.solution.state);
  for (RefinedPair& pair : result->pairs)
    pair.covariance = CovarianceBetween(problem, accepted, posterior, agreed, *result, pair);
}

}  // namespace volalign::refine_internal

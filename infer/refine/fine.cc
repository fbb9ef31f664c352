#include "infer/refine/fine.h"

#include <utility>

#include "core/parallel_for.h"
#include "infer/refine/fine_problem.h"
#include "infer/refine/noise.h"
#include "infer/refine/observations.h"
#include "infer/refine/residuals.h"

namespace volalign::refine_internal {

namespace {

/// m: how far a real box's edges stray from where the structure has them, beyond what its faces do,
/// where boxes are not estimated. On three real captures it was 10-30 mm for faces that fit to 4
/// mm.
constexpr double kHeldEdge = 0.012;

}  // namespace

double LineTolerance(const FreeSet& free) { return free.AllBoxes() ? 0 : kHeldEdge; }

std::vector<SensorEvidence> GatherEvidence(const JointProblem& problem, const State& state,
                                           const FreeSet& free,
                                           std::vector<SensorEvidence> previous) {
  std::vector<SensorEvidence> evidence = std::move(previous);
  evidence.resize(problem.size());
  const Gates gates = FineGates();
  ParallelFor(problem.size(), problem.options.threads, [&](std::size_t i) {
    if (!problem.HasStructureTerms(i)) return;
    evidence[i].noise.line = LineTolerance(free);
    GatherObservations(problem.structure, state, i, *problem.frames[i].points, BlockUse::kFit,
                       {state.poses[i].ToPose()}, gates, &evidence[i]);
    WidenOutliers(problem.model, state.Parameters(i), problem.PriorsOf(i), &evidence[i]);
    FitNoise(problem.model, state.Parameters(i), problem.PriorsOf(i), &evidence[i]);
  });
  return evidence;
}

void UpdateLineTolerance(const JointProblem& problem, const State& state, const FreeSet& free,
                         std::vector<SensorEvidence>* evidence) {
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!problem.HasStructureTerms(i)) continue;
    (*evidence)[i].noise.line = LineTolerance(free);
    SetCovariance(problem.model, state.poses[i].ToPose(), &(*evidence)[i]);
  }
}

bool IsSeen(const JointProblem& problem, const Solution& solution, std::size_t still, int box) {
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (solution.kept_initial[i] || solution.state.StillOf(i) != still) continue;
    for (const FaceObservation& face : solution.evidence[i].faces) {
      if (problem.structure.SideOfLabel(face.label).box == box) return true;
    }
  }
  return false;
}

std::optional<State> SolveFine(const JointProblem& problem, const Solution& solution) {
  State state = solution.state;
  const CeresProblem ceres =
      BuildFineProblem(problem, solution.evidence, solution.kept_initial,
                       problem.layout.Constant(solution.free, solution.kept_initial), &state);
  if (!Minimise(problem.options, ceres.problem.get())) return std::nullopt;
  state.UpdateBuilt(problem.model);
  return state;
}

bool IsUsable(const JointProblem& problem, const Solution& solution, std::size_t frame) {
  const SensorEvidence& evidence = solution.evidence[frame];
  if (!solution.state.poses[frame].ToPose().matrix().allFinite()) return false;
  Eigen::VectorXd r;
  Residuals(problem.model, evidence, solution.state.Parameters(frame), &r, nullptr);
  return r.allFinite() && evidence.face_root.allFinite() && evidence.edge_root.allFinite();
}

void KeepInitial(const JointProblem& problem, std::size_t frame, Solution* solution) {
  solution->state.poses[frame] = PoseBlock(problem.frames[frame].fallback);
  solution->kept_initial[frame] = 1;
  State& state = solution->state;
  state.offsets[frame] = 0;
  state.nuisances[frame] = {};
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (state.SensorOf(i) == state.SensorOf(frame) && !solution->kept_initial[i]) return;
  }
  state.gains[state.SensorOf(frame)] = 0;
}

Solution IterateFine(const JointProblem& problem, Solution solution) {
  const auto exclude = [&](std::size_t i) {
    KeepInitial(problem, i, &solution);
    solution.evidence[i] = SensorEvidence();
  };
  for (int iteration = 0; iteration < problem.options.fine_iterations; ++iteration) {
    solution.evidence =
        GatherEvidence(problem, solution.state, solution.free, std::move(solution.evidence));
    for (std::size_t i = 0; i < problem.size(); ++i) {
      if (solution.kept_initial[i] || !IsUsable(problem, solution, i)) exclude(i);
    }
    std::optional<State> solved = SolveFine(problem, solution);
    if (!solved) {
      for (std::size_t i = 0; i < problem.size(); ++i) exclude(i);
      break;
    }
    solution.state = std::move(*solved);
  }
  return solution;
}

}  // namespace volalign::refine_internal

#include "infer/refine/solution.h"

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "core/base/parallel_for.h"
#include "core/geometry/sensor_kind.h"
#include "infer/refine/noise.h"
#include "infer/refine/observations.h"
#include "infer/refine/residuals.h"
#include "infer/refine/solver.h"
#include "infer/refine/terms.h"

namespace volalign::refine_internal {

namespace {

/// Makes the mean displacement of one capture's boxes zero. Returns the mean.
Eigen::Vector3d TakeMeanOut(std::vector<double>* boxes) {
  // Columns x, z and yaw of each box.
  Eigen::Map<Eigen::Matrix3Xd> all(boxes->data(), 3, static_cast<Eigen::Index>(boxes->size()) / 3);
  const Eigen::Vector2d mean = all.topRows<2>().rowwise().mean();
  all.topRows<2>().colwise() -= mean;
  return {mean.x(), 0, mean.y()};
}

}  // namespace

double LineTolerance(const FreeSet& free) { return free.boxes ? 0 : kHeldEdge; }

std::vector<FrameObservations> GatherObservations(const JointProblem& problem, const State& state,
                                                  const FreeSet& free,
                                                  std::vector<FrameObservations> previous) {
  std::vector<FrameObservations> observed = std::move(previous);
  const std::size_t known = observed.size();
  observed.resize(problem.size());
  for (std::size_t i = known; i < problem.size(); ++i)
    observed[i].noise = UsualNoise(problem.KindOf(i));
  ParallelFor(problem.size(), problem.setup.threads, [&](std::size_t i) {
    observed[i].noise.line = LineTolerance(free);
    GatherObservations(problem.structure, state, i, *problem.frames[i].points, &observed[i]);
    WidenOutliers(problem.model, state.Parameters(i), problem.PriorsOf(i), &observed[i]);
    FitNoise(problem.model, UsualNoise(problem.KindOf(i)).depth, state.Parameters(i),
             problem.PriorsOf(i), &observed[i]);
  });
  return observed;
}

void SetLineTolerance(const JointProblem& problem, double tolerance, Solution* solution) {
  for (std::size_t i = 0; i < problem.size(); ++i) {
    solution->observed[i].noise.line = tolerance;
    SetCovariance(problem.model, solution->state.poses[i].ToPose(), &solution->observed[i]);
  }
}

bool IsSeen(const JointProblem& problem, const Solution& solution, std::size_t capture, int box) {
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (solution.fixed[i] || solution.state.frame_of[i].capture != capture) continue;
    for (const FaceObservation& face : solution.observed[i].faces) {
      if (problem.structure.SideOfLabel(face.label).box == box) return true;
    }
  }
  return false;
}

bool Solve(const JointProblem& problem, Solution* solution) {
  State state = solution->state;
  solution->overlaps = FindOverlaps(problem, solution->observed, solution->fixed, state);
  ceres::Problem ceres =
      BuildCeresProblem(problem, solution->observed, solution->overlaps, solution->fixed,
                        problem.layout.Constant(solution->free, solution->fixed), &state);
  const Minimum minimum = Minimise(problem.setup, &ceres);
  if (!minimum.usable) return false;
  state.converged = minimum.converged;
  state.UpdateBuilt(problem.model);
  solution->state = std::move(state);
  return true;
}

void CentreBoxes(const JointProblem& problem, Solution* solution) {
  if (!solution->free.boxes) return;
  State* state = &solution->state;
  std::vector<Eigen::Vector3d> means;
  for (std::vector<double>& boxes : state->boxes) means.push_back(TakeMeanOut(&boxes));
  for (std::size_t capture = 1; capture < means.size(); ++capture) {
    Pose placement = state->placements[capture].ToPose();
    placement.translation() += placement.linear() * means[capture] - means[0];
    state->placements[capture] = PoseBlock(placement);
  }
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (solution->fixed[i]) continue;
    Eigen::Map<Eigen::Vector3d>(state->poses[i].values + 4) -= means[state->frame_of[i].capture];
  }
  state->UpdateBuilt(problem.model);
}

bool IsUsable(const JointProblem& problem, const Solution& solution, std::size_t frame) {
  const FrameObservations& observed = solution.observed[frame];
  if (!solution.state.poses[frame].ToPose().matrix().allFinite()) return false;
  Eigen::VectorXd r;
  Residuals(problem.model, observed, solution.state.Parameters(frame), &r, nullptr);
  return r.allFinite() && observed.face_root.allFinite() && observed.edge_root.allFinite();
}

void HoldFrame(const JointProblem& problem, std::size_t frame, Solution* solution) {
  solution->state.poses[frame] = PoseBlock(problem.frames[frame].start);
  solution->fixed[frame] = 1;
  State& state = solution->state;
  state.offsets[frame] = 0;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (state.frame_of[i].sensor == state.frame_of[frame].sensor && !solution->fixed[i]) return;
  }
  state.Errors(frame).setZero();
}

Solution AssociateAndSolve(const JointProblem& problem, Solution solution) {
  const auto exclude = [&](std::size_t i) {
    HoldFrame(problem, i, &solution);
    solution.observed[i].Forget();
  };
  for (int iteration = 0; iteration < problem.setup.associations; ++iteration) {
    solution.observed =
        GatherObservations(problem, solution.state, solution.free, std::move(solution.observed));
    for (std::size_t i = 0; i < problem.size(); ++i) {
      if (solution.fixed[i] || !IsUsable(problem, solution, i)) exclude(i);
    }
    if (Solve(problem, &solution)) continue;
    for (std::size_t i = 0; i < problem.size(); ++i) exclude(i);
    solution.overlaps = FindOverlaps(problem, solution.observed, solution.fixed, solution.state);
    break;
  }
  return solution;
}

}  // namespace volalign::refine_internal

#include "infer/refine/acceptance.h"

#include <array>
#include <optional>
#include <utility>

#include "core/base/parallel_for.h"
#include "core/geometry/factor.h"
#include "infer/refine/association.h"
#include "infer/refine/costs.h"
#include "infer/refine/noise.h"
#include "infer/refine/observations.h"
#include "infer/refine/residuals.h"
#include "infer/refine/solution.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

/// Is a refined pose to be taken, judged by the same points as the one to beat?
bool IsAccepted(const JointProblem& problem, const Solution& solution, std::size_t i,
                const FrameObservations& held_out) {
  const State& state = solution.state;
  const auto fit = [&](const Pose& pose, BlockUse use) {
    return FitToStructure(problem.model, problem.priors, state, i, pose,
                          use == BlockUse::kAccept ? held_out : solution.observed[i]);
  };
  const Pose& to_beat = problem.frames[i].to_beat;
  const Pose refined = state.poses[i].ToPose();
  const PoseFit before = fit(to_beat, BlockUse::kAccept), after = fit(refined, BlockUse::kAccept);
  if (before.observations + after.observations > 0) return IsBetter(after, before);
  return IsNoWorse(fit(refined, BlockUse::kFit), fit(to_beat, BlockUse::kFit));
}

}  // namespace

PoseFit FitToStructure(const BuildModel& model, const Priors& priors, const State& state,
                       std::size_t sensor, const Pose& pose, const FrameObservations& observed) {
  if (observed.faces.empty() && observed.edges.empty()) return {};
  const PoseBlock block(pose);
  constexpr std::array<double, kNuisances> kNone = {};
  constexpr std::array<double, kFrameErrors> kLevel = {};
  const double none = 0;
  Eigen::VectorXd r;
  Eigen::MatrixXd jacobian;
  Residuals(model, observed,
            {block.values, &none, &none, &none, kNone.data(), kLevel.data(),
             state.Lens(sensor).data(), state.Build(state.StillOf(sensor))},
            &r, &jacobian);
  constexpr Eigen::Index kOwn = FrameColumns::kOwn;
  const Eigen::VectorXd sigmas = SharedPriorSigmas(priors, observed.noise.depth, {}).head<kOwn>();
  const Eigen::MatrixXd shared =
      jacobian.middleCols<kOwn>(FrameColumns::kOffset) * sigmas.asDiagonal();
  const auto faces = static_cast<Eigen::Index>(observed.faces.size());
  const auto edges = static_cast<Eigen::Index>(observed.edges.size());
  Eigen::MatrixXd covariance = shared * shared.transpose();
  covariance.topLeftCorner(faces, faces) += observed.face_root * observed.face_root.transpose();
  covariance.bottomRightCorner(edges, edges) += observed.edge_root * observed.edge_root.transpose();
  PoseFit fit;
  const std::optional<CholeskyFactor> factor = Factor(covariance);
  if (!factor) return {};
  fit.misfit = r.dot(factor->solve(r)) / static_cast<double>(r.size());
  FrameParameters estimated = state.Parameters(sensor);
  estimated.pose = block.values;
  Residuals(model, observed, estimated, &r, nullptr);
  fit.observations = static_cast<int>(r.size());
  fit.distance = r.cwiseAbs().mean();
  return fit;
}

std::vector<FrameObservations> GatherHeldOut(const JointProblem& problem,
                                             const Solution& solution) {
  std::vector<FrameObservations> held_out(problem.size());
  ParallelFor(problem.size(), problem.setup.schedule.threads, [&](std::size_t i) {
    if (solution.held[i]) return;
    const State& state = solution.state;
    const Pose pose = state.poses[i].ToPose();
    held_out[i].noise = solution.observed[i].noise;
    GatherObservations(problem.structure, state, i, *problem.frames[i].points, BlockUse::kAccept,
                       {pose, problem.frames[i].to_beat}, Gates(), &held_out[i]);
    WidenOutliers(problem.model, state.Parameters(i), problem.PriorsOf(i), &held_out[i]);
    SetCovariance(problem.model, pose, &held_out[i]);
  });
  return held_out;
}

Acceptance AcceptImproved(const JointProblem& problem, Solution solution) {
  const std::vector<FrameObservations> held_out = GatherHeldOut(problem, solution);
  Acceptance result;
  result.refused.assign(problem.size(), Vector6d::Zero());
  for (std::size_t round = 0; round < problem.size(); ++round) {
    bool changed = false;
    for (std::size_t i = 0; i < problem.size(); ++i) {
      if (solution.held[i] || IsAccepted(problem, solution, i, held_out[i])) continue;
      const Pose apart = solution.state.poses[i].ToPose() * problem.frames[i].fallback.inverse();
      result.refused[i] << apart.translation(), RotationLog(apart.linear());
      KeepInitial(problem, i, &solution);
      changed = true;
    }
    if (!changed) break;
    if (!Solve(problem, &solution)) break;
  }
  result.solution = std::move(solution);
  return result;
}

}  // namespace volalign::refine_internal

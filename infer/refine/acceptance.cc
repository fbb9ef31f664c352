#include "infer/refine/acceptance.h"

#include <Eigen/Cholesky>
#include <array>
#include <optional>
#include <utility>

#include "infer/refine/costs.h"
#include "infer/refine/fine.h"
#include "infer/refine/fine_problem.h"
#include "infer/refine/noise.h"
#include "infer/refine/observations.h"
#include "infer/refine/residuals.h"

namespace volalign::refine_internal {

namespace {

constexpr double kNeighbourScale = 0.01;  // m, of the robust cost against neighbours
constexpr double kNeighbourGate = 0.1;    // m
constexpr double kNeighbourCosine = 0.7;  // between normals

/// A refined pose and the one to beat, judged by the same points.
struct Comparison {
  PoseFit before, after;
  bool accepted;
};

Comparison Compare(const JointProblem& problem, const Solution& solution, std::size_t i,
                   const SensorEvidence& held_out) {
  const State& state = solution.state;
  const auto fit = [&](const Pose& pose, BlockUse use) {
    if (!problem.HasStructureTerms(i)) return FitToNeighbours(problem, state, i, pose, use);
    return FitToStructure(problem.model, problem.priors, state, i, pose,
                          use == BlockUse::kAccept ? held_out : solution.evidence[i]);
  };
  const Pose& to_beat = problem.frames[i].to_beat;
  const Pose refined = state.poses[i].ToPose();
  Comparison comparison{fit(to_beat, BlockUse::kAccept), fit(refined, BlockUse::kAccept), false};
  if (comparison.before.observations + comparison.after.observations > 0) {
    comparison.accepted = IsBetter(comparison.after, comparison.before);
  } else {
    comparison.accepted = IsNoWorse(fit(refined, BlockUse::kFit), fit(to_beat, BlockUse::kFit));
  }
  return comparison;
}

}  // namespace

PoseFit FitToStructure(const BuildModel& model, const Priors& priors, const State& state,
                       std::size_t sensor, const Pose& pose, const SensorEvidence& evidence) {
  if (evidence.faces.empty() && evidence.edges.empty()) return {};
  const PoseBlock block(pose);
  constexpr std::array<double, kNuisances> kNone = {};
  const double none = 0;
  Eigen::VectorXd r;
  Eigen::MatrixXd jacobian;
  Residuals(model, evidence,
            {block.values, &none, &none, kNone.data(), state.Lens(sensor).data(),
             state.Build(state.StillOf(sensor))},
            &r, &jacobian);
  constexpr Eigen::Index kOwn = SensorColumns::kOwn;
  const Eigen::VectorXd sigmas =
      SharedPriorSigmas(priors, evidence.noise.multipath, 0).head<kOwn>();
  const Eigen::MatrixXd shared =
      jacobian.middleCols<kOwn>(SensorColumns::kOffset) * sigmas.asDiagonal();
  const auto faces = static_cast<Eigen::Index>(evidence.faces.size());
  const auto edges = static_cast<Eigen::Index>(evidence.edges.size());
  Eigen::MatrixXd covariance = shared * shared.transpose();
  covariance.topLeftCorner(faces, faces) += evidence.face_root * evidence.face_root.transpose();
  covariance.bottomRightCorner(edges, edges) += evidence.edge_root * evidence.edge_root.transpose();
  PoseFit fit;
  const Eigen::LLT<Eigen::MatrixXd> root(covariance);
  if (root.info() != Eigen::Success || !covariance.allFinite()) return {};
  fit.misfit = r.dot(root.solve(r)) / static_cast<double>(r.size());
  SensorParameters estimated = state.Parameters(sensor);
  estimated.pose = block.values;
  Residuals(model, evidence, estimated, &r, nullptr);
  fit.observations = static_cast<int>(r.size());
  fit.distance = r.cwiseAbs().mean();
  return fit;
}

PoseFit FitToNeighbours(const JointProblem& problem, const State& state, std::size_t sensor,
                        const Pose& pose, BlockUse use) {
  OverlapView own = problem.Overlap(sensor, state);
  double sum = 0;
  int count = 0;
  for (std::size_t other = 0; other < problem.size(); ++other) {
    if (other == sensor || problem.frame_of[other].still != problem.frame_of[sensor].still)
      continue;
    const OverlapView neighbour = problem.Overlap(other, state);
    const Pose other_from_this = neighbour.state.structure_from_sensor.inverse() * pose;
    for (const int j : *own.chosen) {
      const CloudPoint& from = own.Cloud(j);
      if (from.use != use) continue;
      const Eigen::Vector3d p = other_from_this * own.state.Corrected(from.p);
      const int nearest = neighbour.points->Nearest(p, kNeighbourGate);
      if (nearest < 0) continue;
      const CloudPoint& to = neighbour.Cloud(nearest);
      if ((other_from_this.linear() * from.normal).dot(to.normal) < kNeighbourCosine) continue;
      sum += RobustCost(to.normal.dot(p - neighbour.state.Corrected(to.p)), kNeighbourScale);
      ++count;
    }
  }
  const double mean = count > 0 ? sum / count : 0;
  return {mean, mean, count};
}

std::vector<SensorEvidence> GatherHeldOut(const JointProblem& problem, const Solution& solution) {
  std::vector<SensorEvidence> held_out(problem.size());
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!problem.HasStructureTerms(i) || solution.kept_initial[i]) continue;
    const State& state = solution.state;
    const Pose pose = state.poses[i].ToPose();
    GatherObservations(problem.structure, state, i, *problem.frames[i].points, BlockUse::kAccept,
                       {pose, problem.frames[i].to_beat}, FineGates(), &held_out[i]);
    WidenOutliers(problem.model, state.Parameters(i), problem.PriorsOf(i), &held_out[i]);
    held_out[i].noise = solution.evidence[i].noise;
    SetCovariance(problem.model, pose, &held_out[i]);
  }
  return held_out;
}

Acceptance AcceptImproved(const JointProblem& problem, Solution solution) {
  const std::vector<SensorEvidence> held_out = GatherHeldOut(problem, solution);
  Acceptance result;
  result.before.resize(problem.size());
  result.refused.assign(problem.size(), Vector6d::Zero());
  for (std::size_t round = 0; round < problem.size(); ++round) {
    bool changed = false;
    for (std::size_t i = 0; i < problem.size(); ++i) {
      if (solution.kept_initial[i]) continue;
      const Comparison comparison = Compare(problem, solution, i, held_out[i]);
      result.before[i] = comparison.before;
      if (comparison.accepted) continue;
      const Pose apart = solution.state.poses[i].ToPose() * problem.frames[i].fallback.inverse();
      result.refused[i] << apart.translation(), RotationLog(apart.linear());
      KeepInitial(problem, i, &solution);
      changed = true;
    }
    if (!changed) break;
    std::optional<State> solved = SolveFine(problem, solution);
    if (!solved) break;
    solution.state = std::move(*solved);
  }
  result.after = result.before;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!solution.kept_initial[i])
      result.after[i] = Compare(problem, solution, i, held_out[i]).after;
  }
  result.solution = std::move(solution);
  return result;
}

}  // namespace volalign::refine_internal

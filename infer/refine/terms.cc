#include "infer/refine/terms.h"

#include <ceres/manifold.h>
#include <cmath>
#include <map>
#include <utility>

#include "infer/refine/costs.h"
#include "infer/refine/pose_manifold.h"
#include "infer/refine/residuals.h"

namespace volalign::refine_internal {

namespace {

/// Overlap away from the structure: one frame's points against the other's measurements. Errors
/// within a correlation length are one error.
void AddOverlapTerms(const JointProblem& problem, const std::vector<FrameObservations>& observed,
                     const PairOverlap& pair, State* state, ceres::Problem* ceres) {
  const std::size_t size = pair.of_a.size() + pair.of_b.size();
  if (size < kFewestMatches) return;  // for their spread
  const double share = pair.cells / static_cast<double>(size);
  const auto through_lens = [&](std::size_t i, const CloudPoint& of, double bounced) {
    const SensorPoints& points = *problem.frames[i].points;
    const DepthErrorModel& errors = observed[i].noise.depth;
    SensorErrorVector by_errors = SensorErrorVector::Zero();
    by_errors.head<kFrameErrors>() = FrameErrorsAt(errors, of.p, of.normal);
    by_errors[kDiffuseMultipath] = bounced;
    by_errors[kGain] = of.p.z();
    return LensPoint{of.p, points.RayByLensAt(of.p), points.lens, by_errors};
  };
  const auto add = [&](std::size_t i, std::size_t j, const std::vector<PairMatch>& matches) {
    if (matches.empty()) return;
    std::vector<MeasuredMatch> measured;
    measured.reserve(matches.size());
    for (const PairMatch& match : matches) {
      measured.push_back({through_lens(i, *match.point, match.multipath_point),
                          through_lens(j, *match.plane, match.multipath_plane), match.plane->normal,
                          1 / (pair.excess * match.sigma)});
    }
    const bool shared = state->frame_of[i].lens == state->frame_of[j].lens;
    std::vector<double*> blocks = {
        state->poses[i].values,  state->poses[j].values,  &state->offsets[i],   &state->offsets[j],
        state->Errors(i).data(), state->Errors(j).data(), state->Lens(i).data()};
    if (!shared) blocks.push_back(state->Lens(j).data());
    ceres->AddResidualBlock(new MeasuredOverlapCost(std::move(measured), share, shared), nullptr,
                            blocks);
  };
  add(pair.a, pair.b, pair.of_a);
  add(pair.b, pair.a, pair.of_b);
}

/// Adds the residuals of one frame.
void AddStructureTerms(const JointProblem& problem, const FrameObservations& observed,
                       std::size_t i, State* state, ceres::Problem* ceres) {
  if (observed.faces.empty()) return;
  ceres->AddResidualBlock(new SensorCost(problem.model, observed), nullptr, state->poses[i].values,
                          &state->offsets[i], state->Errors(i).data(), state->Lens(i).data(),
                          &state->size, state->boxes[state->frame_of[i].capture].data(),
                          state->bulges[state->frame_of[i].capture].data());
}

/// A sensor stays where it is between captures, and so nearly does its depth offset. Each of its
/// frames is tied to its first one that is not fixed.
void AddTies(const JointProblem& problem, const std::vector<char>& fixed, State* state,
             ceres::Problem* ceres) {
  std::map<std::size_t, std::size_t> first_of;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (fixed[i]) continue;
    const auto [entry, is_first] = first_of.emplace(problem.frame_of[i].sensor, i);
    if (is_first) continue;
    const std::size_t first = entry->second;
    ceres->AddResidualBlock(
        TieCost(problem.setup.sensor_moved_sigma_m, problem.setup.sensor_moved_sigma_deg * kDegree),
        nullptr, state->placements[state->frame_of[first].capture].values,
        state->poses[first].values, state->placements[state->frame_of[i].capture].values,
        state->poses[i].values);
    ceres->AddResidualBlock(DriftCost(problem.setup.depth_drift_sigma_m), nullptr,
                            &state->offsets[first], &state->offsets[i]);
  }
}

/// Adds the priors of the sensors' poses, each to the sensor's first frame that is not fixed.
void AddPosePriors(const JointProblem& problem, const std::vector<char>& fixed, State* state,
                   ceres::Problem* ceres) {
  std::vector<char> has_prior(state->errors.size(), 0);
  for (std::size_t i = 0; i < problem.size(); ++i) {
    const std::optional<PosePrior>& prior = problem.frames[i].prior;
    if (fixed[i] || !prior || has_prior[state->frame_of[i].sensor]) continue;
    has_prior[state->frame_of[i].sensor] = 1;
    std::vector<double*> blocks;
    if (prior->world != PriorWorld::kStructure) blocks.push_back(state->world.values);
    if (prior->world == PriorWorld::kScaleFree) blocks.push_back(&state->world_scale);
    blocks.push_back(state->placements[state->frame_of[i].capture].values);
    blocks.push_back(state->poses[i].values);
    ceres->AddResidualBlock(KnownPoseCost(*prior), nullptr, blocks);
  }
}

/// Adds a block with its prior and its constant elements. The prior of a pose is about its current
/// value. A pose is constant as a whole or not at all.
void AddBlock(const ParameterLayout::Block& block, const Eigen::VectorXd& sigmas,
              const std::vector<char>& constant, ceres::Manifold* of_poses, ceres::Problem* ceres) {
  const bool is_pose = block.size != block.tangent_size;
  std::vector<int> elements;
  for (int k = 0; k < block.tangent_size; ++k) {
    if (constant[static_cast<std::size_t>(block.column + k)]) elements.push_back(k);
  }
  const bool is_constant = static_cast<int>(elements.size()) == block.tangent_size;
  ceres::Manifold* manifold = is_pose ? of_poses : nullptr;
  if (!is_pose && !is_constant && !elements.empty())
    manifold = new ceres::SubsetManifold(block.size, elements);
  ceres->AddParameterBlock(block.values, block.size, manifold);
  if (is_constant) ceres->SetParameterBlockConstant(block.values);
  ceres->AddResidualBlock(is_pose ? PosePriorCost(PoseBlock::ToPose(block.values),
                                                  sigmas[block.column], sigmas[block.column + 3])
                                  : PriorCost(sigmas.segment(block.column, block.size)),
                          nullptr, block.values);
}

}  // namespace

Eigen::VectorXd PriorSigmas(const JointProblem& problem,
                            const std::vector<FrameObservations>& observed) {
  std::vector<DepthErrorModel> errors;
  errors.reserve(observed.size());
  for (const FrameObservations& of : observed) errors.push_back(of.noise.depth);
  return problem.layout.PriorSigmas(problem.priors, errors, problem.lenses);
}

ceres::Problem BuildCeresProblem(const JointProblem& problem,
                                 const std::vector<FrameObservations>& observed,
                                 const std::vector<PairOverlap>& overlaps,
                                 const std::vector<char>& fixed, const std::vector<char>& constant,
                                 State* state) {
  ceres::Problem ceres;
  auto* const of_poses = new LeftPoseManifold();  // of all poses; the problem deletes it once
  const ParameterLayout& layout = problem.layout;
  const Eigen::VectorXd sigmas = PriorSigmas(problem, observed)
                                     .cwiseProduct(layout.Scales(state->scales))
                                     .unaryExpr(&Positive);
  for (const ParameterLayout::Block& block : layout.Blocks(state))
    AddBlock(block, sigmas, constant, of_poses, &ceres);
  double* first = state->placements[0].values;
  ceres.AddParameterBlock(first, 7, of_poses);
  ceres.SetParameterBlockConstant(first);
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!constant[static_cast<std::size_t>(layout.Pose(i))])
      AddStructureTerms(problem, observed[i], i, state, &ceres);
  }
  AddTies(problem, fixed, state, &ceres);
  AddPosePriors(problem, fixed, state, &ceres);
  for (std::size_t lens = 0; lens < problem.lenses.size(); ++lens) {
    ceres.AddResidualBlock(LensEvidenceCost(problem.lenses[lens].evidence), nullptr,
                           state->lenses[lens].data());
  }
  for (const PairOverlap& pair : overlaps) AddOverlapTerms(problem, observed, pair, state, &ceres);
  return ceres;
}

}  // namespace volalign::refine_internal

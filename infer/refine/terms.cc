#include "infer/refine/terms.h"

#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "infer/refine/costs.h"
#include "infer/refine/residuals.h"

namespace volalign::refine_internal {

namespace {

/// Overlap that the structure does not hold already: of one frame's points against what the other
/// measured. Errors within a correlation length are one error.
void AddOverlapTerms(const JointProblem& problem, const std::vector<FrameObservations>& observed,
                     const PairOverlap& pair, State* state, CeresProblem* ceres) {
  const std::size_t size = pair.of_a.size() + pair.of_b.size();
  if (size < kFewestMatches) return;  // for their spread
  const double share = pair.cells / static_cast<double>(size);
  const auto through_lens = [&](std::size_t i, const CloudPoint& of, double bounced) {
    const SensorPoints& points = *problem.frames[i].points;
    const DepthErrorModel& errors = observed[i].noise.depth;
    FrameErrorVector by_errors = FrameErrorsAt(errors, of.p, of.normal);
    by_errors[kBounced] = bounced;
    return LensPoint{of.p, points.RayByLensAt(of.p), points.lens, by_errors};
  };
  const auto add = [&](std::size_t i, std::size_t j, const std::vector<PairMatch>& matches) {
    if (matches.empty()) return;
    std::vector<MeasuredMatch> measured;
    measured.reserve(matches.size());
    for (const PairMatch& match : matches) {
      measured.push_back({through_lens(i, *match.point, match.bounced_point),
                          through_lens(j, *match.plane, match.bounced_plane), match.plane->normal,
                          1 / (pair.excess * match.sigma)});
    }
    const bool shared = state->LensOf(i) == state->LensOf(j);
    std::vector<double*> blocks = {
        state->poses[i].values, state->poses[j].values, &state->offsets[i],   &state->offsets[j],
        state->Gain(i),         state->Gain(j),         state->Focal(i),      state->Focal(j),
        state->Errors(i),       state->Errors(j),       state->Lens(i).data()};
    if (!shared) blocks.push_back(state->Lens(j).data());
    ceres->problem->AddResidualBlock(new MeasuredOverlapCost(std::move(measured), share, shared),
                                     nullptr, blocks);
  };
  add(pair.a, pair.b, pair.of_a);
  add(pair.b, pair.a, pair.of_b);
}

/// Priors of a block whose columns begin at `column`.
void AddPriors(const Eigen::VectorXd& sigmas, Eigen::Index column, std::size_t count,
               double* values, CeresProblem* ceres) {
  ceres->problem->AddResidualBlock(
      PriorCost(sigmas.segment(column, static_cast<Eigen::Index>(count))), nullptr, values);
}

/// Priors of the errors of frames whose poses are sought, and of their sensors.
void AddSensorPriors(const JointProblem& problem, const Eigen::VectorXd& sigmas,
                     const std::vector<char>& constant, State* state, CeresProblem* ceres) {
  std::set<int> sought;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (constant[static_cast<std::size_t>(problem.layout.Pose(i))]) continue;
    sought.insert(problem.frame_of[i].sensor);
    AddPriors(sigmas, problem.layout.Offset(i), 1, &state->offsets[i], ceres);
    AddPriors(sigmas, problem.layout.Nuisance(i, 0), kNuisances, state->nuisances[i].data(), ceres);
  }
  for (const int sensor : sought) {
    const auto s = static_cast<std::size_t>(sensor);
    AddPriors(sigmas, problem.layout.GainOfSensor(s), 1, &state->gains[s], ceres);
    AddPriors(sigmas, problem.layout.FocalOfSensor(s), 1, &state->focals[s], ceres);
    AddPriors(sigmas, problem.layout.ErrorsOfSensor(s), kFrameErrors, state->errors[s].data(),
              ceres);
  }
}

/// Residuals of one frame.
void AddStructureTerms(const JointProblem& problem, const FrameObservations& observed,
                       std::size_t i, State* state, CeresProblem* ceres) {
  if (observed.faces.empty()) return;
  ceres->problem->AddResidualBlock(
      new SensorCost(problem.model, observed), nullptr, state->poses[i].values, &state->offsets[i],
      state->Gain(i), state->Focal(i), state->nuisances[i].data(), state->Errors(i),
      state->Lens(i).data(), &state->size, state->boxes[state->StillOf(i)].data(),
      state->bulges[state->StillOf(i)].data());
}

/// A sensor stays where it is between stills, and its depth offset nearly so. Each of its frames is
/// tied to its first that counts.
void AddTies(const JointProblem& problem, const std::vector<char>& held, State* state,
             CeresProblem* ceres) {
  std::map<int, std::size_t> first_of;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (held[i]) continue;
    const auto [entry, is_first] = first_of.emplace(problem.frame_of[i].sensor, i);
    if (is_first) continue;
    const std::size_t first = entry->second;
    ceres->problem->AddResidualBlock(
        TieCost(problem.setup.prior.sensor_moved_sigma_m,
                problem.setup.prior.sensor_moved_sigma_deg * kDegree),
        nullptr, state->placements[state->StillOf(first)].values, state->poses[first].values,
        state->placements[state->StillOf(i)].values, state->poses[i].values);
    ceres->problem->AddResidualBlock(DriftCost(problem.setup.prior.depth_drift_sigma_m), nullptr,
                                     &state->offsets[first], &state->offsets[i]);
  }
}

/// The placements of all stills, with loose priors. The first stands where it stands.
void AddPlacements(const ParameterLayout& layout, const Eigen::VectorXd& sigmas, State* state,
                   CeresProblem* ceres) {
  for (std::size_t still = 0; still < layout.stills(); ++still) {
    double* placement = state->placements[still].values;
    ceres->problem->AddParameterBlock(placement, 7, ceres->manifold.get());
    if (still == 0) {
      ceres->problem->SetParameterBlockConstant(placement);
      continue;
    }
    const Eigen::Index column = layout.Placement(still);
    ceres->problem->AddResidualBlock(
        PosePriorCost(state->placements[still].ToPose(), sigmas[column], sigmas[column + 3]),
        nullptr, placement);
  }
}

/// The size and the boxes of all stills, with their priors.
void AddBuild(const ParameterLayout& layout, const Eigen::VectorXd& sigmas, State* state,
              CeresProblem* ceres) {
  ceres->problem->AddParameterBlock(&state->size, 1);
  AddPriors(sigmas, layout.Size(), 1, &state->size, ceres);
  for (std::size_t still = 0; still < layout.stills(); ++still) {
    std::vector<double>& boxes = state->boxes[still];
    ceres->problem->AddParameterBlock(boxes.data(), static_cast<int>(boxes.size()));
    AddPriors(sigmas, layout.Boxes(still), boxes.size(), boxes.data(), ceres);
    std::vector<double>& bulges = state->bulges[still];
    ceres->problem->AddParameterBlock(bulges.data(), static_cast<int>(bulges.size()));
    AddPriors(sigmas, layout.Bulges(still), bulges.size(), bulges.data(), ceres);
  }
}

/// Priors of the lenses, and what large planes say.
void AddLensTerms(const JointProblem& problem, const Eigen::VectorXd& sigmas, State* state,
                  CeresProblem* ceres) {
  for (std::size_t lens = 0; lens < problem.lenses.size(); ++lens) {
    double* change = state->lenses[lens].data();
    AddPriors(sigmas, problem.layout.Lens(lens), kLensParameters, change, ceres);
    ceres->problem->AddResidualBlock(LensEvidenceCost(problem.lenses[lens].evidence), nullptr,
                                     change);
  }
}

/// Tells Ceres which parameters stay as they are.
void HoldConstant(const ParameterLayout& layout, const std::vector<char>& constant, State* state,
                  CeresProblem* ceres) {
  for (const ParameterLayout::Block& block : layout.Blocks(state)) {
    std::vector<int> elements;
    for (int k = 0; k < block.tangent_size; ++k) {
      if (constant[static_cast<std::size_t>(block.column + k)]) elements.push_back(k);
    }
    ceres->HoldConstant(block.values, block.tangent_size, elements);
  }
}

}  // namespace

Eigen::VectorXd PriorSigmas(const JointProblem& problem,
                            const std::vector<FrameObservations>& observed) {
  std::vector<DepthErrorModel> errors;
  errors.reserve(observed.size());
  for (const FrameObservations& of : observed) errors.push_back(of.noise.depth);
  return problem.layout.PriorSigmas(problem.priors, errors, problem.lenses);
}

CeresProblem BuildCeresProblem(const JointProblem& problem,
                               const std::vector<FrameObservations>& observed,
                               const std::vector<PairOverlap>& overlaps,
                               const std::vector<char>& held, const std::vector<char>& constant,
                               State* state) {
  CeresProblem ceres;
  const ParameterLayout& layout = problem.layout;
  const Eigen::VectorXd sigmas = PriorSigmas(problem, observed)
                                     .cwiseProduct(layout.Scales(state->scales))
                                     .unaryExpr(&Positive);
  for (std::size_t i = 0; i < problem.size(); ++i) {
    double* pose = state->poses[i].values;
    ceres.problem->AddParameterBlock(pose, 7, ceres.manifold.get());
    ceres.problem->AddParameterBlock(&state->offsets[i], 1);
    ceres.problem->AddParameterBlock(state->Gain(i), 1);
    ceres.problem->AddParameterBlock(state->Focal(i), 1);
    ceres.problem->AddParameterBlock(state->nuisances[i].data(), kNuisances);
    ceres.problem->AddParameterBlock(state->Errors(i), kFrameErrors);
    ceres.problem->AddParameterBlock(state->Lens(i).data(), kLensParameters);
    const Eigen::Index column = layout.Pose(i);
    ceres.problem->AddResidualBlock(
        PosePriorCost(state->poses[i].ToPose(), sigmas[column], sigmas[column + 3]), nullptr, pose);
    if (!constant[static_cast<std::size_t>(column)])
      AddStructureTerms(problem, observed[i], i, state, &ceres);
  }
  AddPlacements(layout, sigmas, state, &ceres);
  AddSensorPriors(problem, sigmas, constant, state, &ceres);
  AddTies(problem, held, state, &ceres);
  AddLensTerms(problem, sigmas, state, &ceres);
  AddBuild(layout, sigmas, state, &ceres);
  HoldConstant(layout, constant, state, &ceres);
  for (const PairOverlap& pair : overlaps) AddOverlapTerms(problem, observed, pair, state, &ceres);
  return ceres;
}

}  // namespace volalign::refine_internal

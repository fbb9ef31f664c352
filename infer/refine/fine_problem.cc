#include "infer/refine/fine_problem.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "core/statistics.h"
#include "core/visibility.h"
#include "infer/refine/costs.h"
#include "infer/refine/residuals.h"

namespace volalign::refine_internal {

namespace {

constexpr double kSideGate = 0.06;  // m, of a point to its side
constexpr double kPairGate = 0.02;  // m, of matched points of a pair
constexpr double kAngleGate = 20;   // deg, between their normals
// Overlap off the structure.
constexpr double kOverlapGate = 0.06;  // m
/// Share of its distance from the optical axis by which a point is off for errors of the
/// intrinsics, which the structure, in the middle of the frame, hardly shows.
constexpr double kIntrinsicsError = 0.002;
constexpr double kLeastWarp = 1e-3;  // m at 2 m
/// m: nearer to the structure than this, overlap says what the structure's own terms say already.
constexpr double kOffStructure = 0.05;

/// Two points of the same surface, seen by two sensors.
struct WeightedMatch {
  const CloudPoint *from, *to;
  double sigma;     // m
  double residual;  // m
};

/// Standard deviation, m, of a cloud point's depth.
double PointSigma(const NoiseModel& noise, const Eigen::Vector3d& p) {
  return std::hypot(std::max(noise.warp, kLeastWarp) * p.z() * p.z() / 4,
                    kIntrinsicsError * p.head<2>().norm());
}

/// Matches of a's points with b's that say more than the structure does.
std::vector<WeightedMatch> InformativeMatches(const JointProblem& problem,
                                              const std::vector<SensorEvidence>& evidence,
                                              const State& state, std::size_t a, std::size_t b) {
  const bool both_on_structure = problem.HasStructureTerms(a) && problem.HasStructureTerms(b);
  const OverlapView from_view = problem.Overlap(a, state), to_view = problem.Overlap(b, state);
  std::vector<WeightedMatch> informative;
  const std::vector<Match> matches =
      FindMatches(from_view, to_view, kOverlapGate, FineGates().min_cosine);
  if (!SeeEnough(matches.size(), from_view, problem.options.min_overlap)) return informative;
  for (const Match& match : matches) {
    const CloudPoint& from = from_view.Cloud(match.from);
    const CloudPoint& to = to_view.Cloud(match.to);
    if (from.use != BlockUse::kFit || to.use != BlockUse::kFit) continue;
    const double sigma =
        std::hypot(PointSigma(evidence[a].noise, from.p), PointSigma(evidence[b].noise, to.p));
    if (both_on_structure) {
      if (sigma > kOverlapGate / 2) continue;
      const Eigen::Vector3d p = from_view.state.InStructure(from.p);
      if (DistanceToSurface(state.Built(a), p).distance < kOffStructure) continue;
    }
    informative.push_back({&from, &to, sigma, match.residual});
  }
  return informative;
}

/// Cells of one correlation length of the depth errors, rad, that the points of `from` lie in.
std::size_t CountCells(const std::vector<WeightedMatch>& matches, double cell) {
  std::set<std::pair<int, int>> cells;
  for (const WeightedMatch& match : matches) {
    const Eigen::Vector3d& p = match.from->p;
    cells.insert({static_cast<int>(std::floor(p.x() / p.z() / cell)),
                  static_cast<int>(std::floor(p.y() / p.z() / cell))});
  }
  return cells.size();
}

/// Points that two sensors see, and that the structure does not hold already. Errors within a
/// correlation length are one error.
void AddOverlapTerms(const JointProblem& problem, const std::vector<SensorEvidence>& evidence,
                     const std::vector<char>& kept_initial, std::size_t a, std::size_t b,
                     State* state, CeresProblem* ceres) {
  if (problem.HasStructureTerms(a) && problem.HasStructureTerms(b) &&
      (kept_initial[a] || kept_initial[b]))
    return;
  const std::vector<WeightedMatch> matches = InformativeMatches(problem, evidence, *state, a, b);
  if (matches.size() < kFewestMatches) return;  // for their spread
  const std::size_t cells =
      CountCells(matches, std::max(evidence[a].noise.warp_length, evidence[b].noise.warp_length));
  std::vector<double> sizes;
  sizes.reserve(matches.size());
  for (const WeightedMatch& match : matches)
    sizes.push_back(std::abs(match.residual) / match.sigma);
  const double excess = std::max(1.0, kMadToSigma * Median(std::move(sizes)));
  const double share =
      std::sqrt(static_cast<double>(cells) / static_cast<double>(matches.size())) / excess;
  for (const WeightedMatch& match : matches) {
    const auto through_lens = [&](std::size_t i, const Eigen::Vector3d& p) {
      const SensorPoints& points = *problem.frames[i].points;
      return LensPoint{p, points.RayByLensAt(p), points.lens};
    };
    const bool shared = state->LensOf(a) == state->LensOf(b);
    std::vector<double*> blocks = {state->poses[a].values, state->poses[b].values,
                                   &state->offsets[a], &state->offsets[b], state->Lens(a).data()};
    if (!shared) blocks.push_back(state->Lens(b).data());
    ceres->problem->AddResidualBlock(
        new OverlapThroughLensCost(through_lens(a, match.from->p), through_lens(b, match.to->p),
                                   match.to->normal, share / match.sigma, shared),
        ceres->loss.get(), blocks);
  }
}

/// Priors of the errors of frames whose poses are sought, and of their sensors.
void AddSensorPriors(const JointProblem& problem, const Eigen::VectorXd& sigmas,
                     const std::vector<char>& constant, State* state, CeresProblem* ceres) {
  std::set<int> sought;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (constant[static_cast<std::size_t>(problem.layout.Pose(i))]) continue;
    sought.insert(problem.frame_of[i].sensor);
    ceres->problem->AddResidualBlock(new PriorCost({sigmas[problem.layout.Offset(i)]}), nullptr,
                                     &state->offsets[i]);
    const double* of_nuisances = sigmas.data() + problem.layout.Nuisance(i, 0);
    ceres->problem->AddResidualBlock(
        new PriorCost(std::vector<double>(of_nuisances, of_nuisances + kNuisances)), nullptr,
        state->nuisances[i].data());
  }
  for (const int sensor : sought) {
    const auto s = static_cast<std::size_t>(sensor);
    ceres->problem->AddResidualBlock(new PriorCost({sigmas[problem.layout.GainOfSensor(s)]}),
                                     nullptr, &state->gains[s]);
  }
}

/// Residuals of one frame.
void AddStructureTerms(const JointProblem& problem, const SensorEvidence& evidence, std::size_t i,
                       State* state, CeresProblem* ceres) {
  if (!problem.HasStructureTerms(i) || evidence.faces.empty()) return;
  ceres->problem->AddResidualBlock(new SensorCost(problem.model, evidence), nullptr,
                                   state->poses[i].values, &state->offsets[i], state->Gain(i),
                                   state->nuisances[i].data(), state->Lens(i).data(), &state->size,
                                   state->boxes[state->StillOf(i)].data());
}

/// A sensor stays where it is between stills, and its depth offset nearly so. Each of its frames is
/// tied to its first that counts.
void AddTies(const JointProblem& problem, const std::vector<char>& kept_initial, State* state,
             CeresProblem* ceres) {
  std::map<int, std::size_t> first_of;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (kept_initial[i]) continue;
    const auto [entry, is_first] = first_of.emplace(problem.frame_of[i].sensor, i);
    if (is_first) continue;
    const std::size_t first = entry->second;
    ceres->problem->AddResidualBlock(
        TieCost(problem.options.sensor_moved_sigma_m,
                problem.options.sensor_moved_sigma_deg * M_PI / 180),
        nullptr, state->placements[state->StillOf(first)].values, state->poses[first].values,
        state->placements[state->StillOf(i)].values, state->poses[i].values);
    ceres->problem->AddResidualBlock(DriftCost(problem.options.depth_drift_sigma_m), nullptr,
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
        new PosePriorCost(state->placements[still].ToPose(), sigmas[column], sigmas[column + 3]),
        nullptr, placement);
  }
}

/// The size and the boxes of all stills, with their priors.
void AddBuild(const ParameterLayout& layout, const Eigen::VectorXd& sigmas, State* state,
              CeresProblem* ceres) {
  ceres->problem->AddParameterBlock(&state->size, 1);
  ceres->problem->AddResidualBlock(new PriorCost({sigmas[layout.Size()]}), nullptr, &state->size);
  for (std::size_t still = 0; still < layout.stills(); ++still) {
    std::vector<double>& boxes = state->boxes[still];
    const double* prior = sigmas.data() + layout.Boxes(still);
    ceres->problem->AddParameterBlock(boxes.data(), static_cast<int>(boxes.size()));
    ceres->problem->AddResidualBlock(
        new PriorCost(std::vector<double>(prior, prior + boxes.size())), nullptr, boxes.data());
  }
}

/// Priors of the lenses, and what large planes say.
void AddLensTerms(const JointProblem& problem, const Eigen::VectorXd& sigmas, State* state,
                  CeresProblem* ceres) {
  for (std::size_t lens = 0; lens < problem.lenses.size(); ++lens) {
    const double* prior = sigmas.data() + problem.layout.Lens(lens);
    double* change = state->lenses[lens].data();
    ceres->problem->AddResidualBlock(
        new PriorCost(std::vector<double>(prior, prior + kLensParameters)), nullptr, change);
    ceres->problem->AddResidualBlock(new LensEvidenceCost(problem.lenses[lens].evidence), nullptr,
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

Gates FineGates() { return {kSideGate, kPairGate, std::cos(kAngleGate * M_PI / 180)}; }

Eigen::VectorXd PriorSigmas(const JointProblem& problem,
                            const std::vector<SensorEvidence>& evidence) {
  std::vector<double> multipath;
  multipath.reserve(evidence.size());
  for (const SensorEvidence& of : evidence) multipath.push_back(of.noise.multipath);
  return problem.layout.PriorSigmas(problem.priors, multipath, problem.lenses);
}

CeresProblem BuildFineProblem(const JointProblem& problem,
                              const std::vector<SensorEvidence>& evidence,
                              const std::vector<char>& kept_initial,
                              const std::vector<char>& constant, State* state) {
  CeresProblem ceres;
  const ParameterLayout& layout = problem.layout;
  const Eigen::VectorXd sigmas = PriorSigmas(problem, evidence)
                                     .cwiseProduct(layout.Scales(state->scales))
                                     .unaryExpr(&Positive);
  for (std::size_t i = 0; i < problem.size(); ++i) {
    double* pose = state->poses[i].values;
    ceres.problem->AddParameterBlock(pose, 7, ceres.manifold.get());
    ceres.problem->AddParameterBlock(&state->offsets[i], 1);
    ceres.problem->AddParameterBlock(state->Gain(i), 1);
    ceres.problem->AddParameterBlock(state->nuisances[i].data(), kNuisances);
    ceres.problem->AddParameterBlock(state->Lens(i).data(), kLensParameters);
    const Eigen::Index column = layout.Pose(i);
    ceres.problem->AddResidualBlock(
        new PosePriorCost(state->poses[i].ToPose(), sigmas[column], sigmas[column + 3]), nullptr,
        pose);
    if (!constant[static_cast<std::size_t>(column)])
      AddStructureTerms(problem, evidence[i], i, state, &ceres);
  }
  AddPlacements(layout, sigmas, state, &ceres);
  AddSensorPriors(problem, sigmas, constant, state, &ceres);
  AddTies(problem, kept_initial, state, &ceres);
  AddLensTerms(problem, sigmas, state, &ceres);
  AddBuild(layout, sigmas, state, &ceres);
  HoldConstant(layout, constant, state, &ceres);
  for (std::size_t a = 0; a < problem.size(); ++a) {
    for (std::size_t b = 0; b < problem.size(); ++b) {
      if (problem.OverlapCounts(a, b))
        AddOverlapTerms(problem, evidence, kept_initial, a, b, state, &ceres);
    }
  }
  return ceres;
}

}  // namespace volalign::refine_internal

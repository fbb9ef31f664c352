#include "infer/refine/fine_problem.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "core/base/parallel_for.h"
#include "core/base/statistics.h"
#include "core/geometry/visibility.h"
#include "infer/refine/costs.h"
#include "infer/refine/residuals.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

constexpr double kSideGate = 2 * kRoughPose;  // m, of a point to its side
constexpr double kPairGate = kSamePlace;      // m, of matched points of a pair
// Overlap off the structure.
constexpr double kOverlapGate = kSideGate;
/// Share of its distance from the optical axis by which a point is off for errors of the
/// intrinsics, which the structure, in the middle of the frame, hardly shows.
constexpr double kIntrinsicsError = 0.002;
/// m: nearer to the structure than this, overlap says what the structure's own terms say already.
constexpr double kOffStructure = 0.05;

/// A point of one sensor of a pair, and what the other one measured of the same surface.
struct PairMatch {
  std::size_t from, to;  // frames
  const CloudPoint *point, *plane;
  double sigma;     // m
  double residual;  // m
};

/// The matches of two frames, both ways, that say more than the structure does, and how many
/// independent measurements they are.
struct PairMatches {
  std::vector<PairMatch> matches;
  double cells = 0;
};

/// Standard deviation, m, of a cloud point's depth.
double PointSigma(const NoiseModel& noise, const Eigen::Vector3d& p) {
  return std::hypot(std::max(noise.depth.Smooth(p.z()), kDepthStep),
                    kIntrinsicsError * p.head<2>().norm());
}

/// One sensor's part in a pair, and what its errors are in the points that matched: the sum of
/// their variances, m^2, and the cells of one correlation length that they lie in.
struct PairEnd {
  std::size_t frame;
  OverlapEnd view;
  const NoiseModel& noise;
  double variance = 0;
  std::set<std::pair<int, int>> cells = {};

  void Count(const Eigen::Vector3d& p) {
    const double sigma = PointSigma(noise, p);
    variance += sigma * sigma;
    const Eigen::Vector2d at = p.head<2>() / p.z() / noise.depth.smooth_rad;
    cells.insert({static_cast<int>(std::floor(at.x())), static_cast<int>(std::floor(at.y()))});
  }
};

PairMatches InformativeMatches(const JointProblem& problem,
                               const std::vector<FrameObservations>& observed, const State& state,
                               std::size_t a, std::size_t b) {
  const bool both_on_structure = problem.HasStructureTerms(a) && problem.HasStructureTerms(b);
  PairEnd end_a{a, problem.Overlap(a, state), observed[a].noise};
  PairEnd end_b{b, problem.Overlap(b, state), observed[b].noise};
  const SharedPoints shared =
      FindShared(end_a.view, end_b.view, kOverlapGate, FineGates().min_cosine);
  PairMatches informative;
  if (!shared.IsPair(problem.setup.schedule.min_overlap)) return informative;
  const auto add = [&](PairEnd* from_end, PairEnd* to_end, const std::vector<Match>& matches) {
    for (const Match& match : matches) {
      const CloudPoint& from = from_end->view.Cloud(match.from);
      const CloudPoint& to = to_end->view.Cloud(match.to);
      if (from.use != BlockUse::kFit || to.use != BlockUse::kFit) continue;
      const double sigma =
          std::hypot(PointSigma(from_end->noise, from.p), PointSigma(to_end->noise, to.p));
      if (both_on_structure) {
        if (sigma > kOverlapGate / 2) continue;
        const Eigen::Vector3d p = from_end->view.state.InStructure(from.p);
        if (DistanceToSurface(state.Built(a), p).distance < kOffStructure) continue;
      }
      informative.matches.push_back(
          {from_end->frame, to_end->frame, &from, &to, sigma, match.residual});
      from_end->Count(from.p);
      to_end->Count(to.p);
    }
  };
  add(&end_a, &end_b, shared.of_a);
  add(&end_b, &end_a, shared.of_b);
  if (informative.matches.empty()) return informative;
  // As many independent residuals have a mean as uncertain as that of these, each sensor's errors
  // being independent from cell to cell.
  const auto of_mean = [](const PairEnd& end) {
    return end.variance / static_cast<double>(end.cells.size());
  };
  informative.cells = (end_a.variance + end_b.variance) / (of_mean(end_a) + of_mean(end_b));
  return informative;
}

/// Points that two sensors see, and that the structure does not hold already. Errors within a
/// correlation length are one error.
void AddOverlapTerms(const JointProblem& problem, const PairMatches& pair, State* state,
                     CeresProblem* ceres) {
  const auto& [matches, cells] = pair;
  if (matches.size() < kFewestMatches) return;  // for their spread
  std::vector<double> sizes;
  sizes.reserve(matches.size());
  for (const PairMatch& match : matches) sizes.push_back(std::abs(match.residual) / match.sigma);
  const double excess = std::max(1.0, kMadToSigma * Median(std::move(sizes)));
  ceres::LossFunction* loss = ceres->Weighted(cells / static_cast<double>(matches.size()));
  const auto through_lens = [&](std::size_t i, const Eigen::Vector3d& p) {
    const SensorPoints& points = *problem.frames[i].points;
    return LensPoint{p, points.RayByLensAt(p), points.lens};
  };
  for (const PairMatch& match : matches) {
    const std::size_t i = match.from, j = match.to;
    const bool shared = state->LensOf(i) == state->LensOf(j);
    std::vector<double*> blocks = {
        state->poses[i].values, state->poses[j].values, &state->offsets[i],   &state->offsets[j],
        state->Gain(i),         state->Gain(j),         state->Lens(i).data()};
    if (!shared) blocks.push_back(state->Lens(j).data());
    ceres->problem->AddResidualBlock(
        new MeasuredOverlapCost(through_lens(i, match.point->p), through_lens(j, match.plane->p),
                                match.plane->normal, 1 / (excess * match.sigma), shared),
        loss, blocks);
  }
}

/// Priors of a block whose columns begin at `column`.
void AddPriors(const Eigen::VectorXd& sigmas, Eigen::Index column, std::size_t count,
               double* values, CeresProblem* ceres) {
  const double* first = sigmas.data() + column;
  ceres->problem->AddResidualBlock(new PriorCost(std::vector<double>(first, first + count)),
                                   nullptr, values);
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
  }
}

/// Residuals of one frame.
void AddStructureTerms(const JointProblem& problem, const FrameObservations& observed,
                       std::size_t i, State* state, CeresProblem* ceres) {
  if (!problem.HasStructureTerms(i) || observed.faces.empty()) return;
  ceres->problem->AddResidualBlock(new SensorCost(problem.model, observed), nullptr,
                                   state->poses[i].values, &state->offsets[i], state->Gain(i),
                                   state->nuisances[i].data(), state->Lens(i).data(), &state->size,
                                   state->boxes[state->StillOf(i)].data());
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
                problem.setup.prior.sensor_moved_sigma_deg * M_PI / 180),
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
        new PosePriorCost(state->placements[still].ToPose(), sigmas[column], sigmas[column + 3]),
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
  }
}

/// Priors of the lenses, and what large planes say.
void AddLensTerms(const JointProblem& problem, const Eigen::VectorXd& sigmas, State* state,
                  CeresProblem* ceres) {
  for (std::size_t lens = 0; lens < problem.lenses.size(); ++lens) {
    double* change = state->lenses[lens].data();
    AddPriors(sigmas, problem.layout.Lens(lens), kLensParameters, change, ceres);
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

Gates FineGates() { return {kSideGate, kPairGate, kOnePlane}; }

Eigen::VectorXd PriorSigmas(const JointProblem& problem,
                            const std::vector<FrameObservations>& observed) {
  std::vector<double> multipath;
  multipath.reserve(observed.size());
  for (const FrameObservations& of : observed) multipath.push_back(of.noise.depth.seam_m);
  return problem.layout.PriorSigmas(problem.priors, multipath, problem.lenses);
}

CeresProblem BuildFineProblem(const JointProblem& problem,
                              const std::vector<FrameObservations>& observed,
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
    ceres.problem->AddParameterBlock(state->nuisances[i].data(), kNuisances);
    ceres.problem->AddParameterBlock(state->Lens(i).data(), kLensParameters);
    const Eigen::Index column = layout.Pose(i);
    ceres.problem->AddResidualBlock(
        new PosePriorCost(state->poses[i].ToPose(), sigmas[column], sigmas[column + 3]), nullptr,
        pose);
    if (!constant[static_cast<std::size_t>(column)])
      AddStructureTerms(problem, observed[i], i, state, &ceres);
  }
  AddPlacements(layout, sigmas, state, &ceres);
  AddSensorPriors(problem, sigmas, constant, state, &ceres);
  AddTies(problem, held, state, &ceres);
  AddLensTerms(problem, sigmas, state, &ceres);
  AddBuild(layout, sigmas, state, &ceres);
  HoldConstant(layout, constant, state, &ceres);
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t a = 0; a < problem.size(); ++a) {
    for (std::size_t b = a + 1; b < problem.size(); ++b) {
      const bool left_out =
          problem.HasStructureTerms(a) && problem.HasStructureTerms(b) && (held[a] || held[b]);
      if (!left_out && problem.OverlapCounts(a, b)) pairs.emplace_back(a, b);
    }
  }
  std::vector<PairMatches> matches(pairs.size());
  ParallelFor(pairs.size(), problem.setup.schedule.threads, [&](std::size_t k) {
    matches[k] = InformativeMatches(problem, observed, *state, pairs[k].first, pairs[k].second);
  });
  for (const PairMatches& of_pair : matches) AddOverlapTerms(problem, of_pair, state, &ceres);
  return ceres;
}

}  // namespace volalign::refine_internal

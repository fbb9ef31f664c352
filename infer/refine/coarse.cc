#include "infer/refine/coarse.h"

#include <algorithm>
#include <cmath>

#include "core/base/statistics.h"
#include "infer/refine/costs.h"
#include "infer/refine/solver.h"

namespace volalign::refine_internal {

namespace {

// Gates: the first iteration's, what each keeps of the last one's, and the least.
constexpr double kShrink = 0.6;
constexpr double kFirstSideGate = 0.15, kLeastSideGate = 0.06;        // m
constexpr double kFirstOverlapGate = 0.12, kLeastOverlapGate = 0.02;  // m
constexpr double kFirstAngleGate = 45, kLeastAngleGate = 20;          // deg
// Standard deviations, m, that residuals are divided by.
constexpr double kFirstScale = 0.03, kScaleShrink = 0.5;  // the least one, by iteration
constexpr double kStartSigma = 0.005;                     // a sensor's own, before it is measured
constexpr double kLeastScaleSigma = 5e-4;  // below it the depth's own resolution counts
/// How far a real box's edges stray from where the structure has them, beyond what its faces do. On
/// three real captures it was 10-30 mm for faces that fit to 4 mm: boxes are placed by hand,
/// cardboard bulges, and sensors fatten edges.
constexpr double kEdgeTolerance = 0.008;
/// A silhouette point and the face round the corner that another sensor sees: how far behind the
/// edge it is sought, m, and the cosine of its normal with the silhouette's direction.
constexpr double kRoundTheCorner = 0.02, kFacesOutward = 0.7;

double LeastScale(int iteration) { return kFirstScale * std::pow(kScaleShrink, iteration); }

/// One solution of the coarse stage.
struct Coarse {
  const JointProblem& problem;
  const std::vector<double>& sigmas;  // m, of each sensor's points
  Gates gates;
  double least_scale;
  State* state;  // what Ceres moves, where it is before that
  CeresProblem* ceres;
};

void AddStructureTerms(const Coarse& coarse, std::size_t i) {
  const JointProblem& problem = coarse.problem;
  const FrameState sensor = coarse.state->Frame(i);
  const double sigma = std::max(coarse.sigmas[i], coarse.least_scale);
  double* pose = coarse.state->poses[i].values;
  for (const SidePoint& point : problem.frames[i].points->side_points) {
    if (point.use != BlockUse::kFit ||
        !LiesOnItsSide(coarse.state->Built(i), sensor, point, coarse.gates.side))
      continue;
    coarse.ceres->problem->AddResidualBlock(
        new SideCost(sensor.Corrected(point.p), problem.structure.SideOfLabel(point.label),
                     1 / sigma),
        coarse.ceres->loss.get(), pose);
  }
  const double weight = std::sqrt(problem.setup.schedule.edge_weight);
  for (const EdgePoint& edge : problem.frames[i].points->edge_points) {
    EdgeLine line;
    if (edge.use != BlockUse::kFit ||
        !LiesOnAnEdge(coarse.state->Built(i), sensor, edge, coarse.gates.side, &line))
      continue;
    coarse.ceres->problem->AddResidualBlock(
        new LineCost(sensor.Corrected(edge.p), line.direction, line.offset,
                     weight / std::hypot(sigma, edge.sigma, kEdgeTolerance)),
        coarse.ceres->loss.get(), pose);
  }
}

/// a's points against the planes that b measured. `matches`: of the two.
void AddMatches(const Coarse& coarse, std::size_t a, std::size_t b, const OverlapEnd& from_view,
                const OverlapEnd& to_view, const std::vector<Match>& matches) {
  const JointProblem& problem = coarse.problem;
  const double sigma = std::max(std::hypot(coarse.sigmas[a], coarse.sigmas[b]), coarse.least_scale);
  const double weight = std::sqrt(problem.setup.schedule.overlap_weight) / sigma;
  const auto add = [&](const Eigen::Vector3d& p, const CloudPoint& to, double its_weight) {
    coarse.ceres->problem->AddResidualBlock(
        new OverlapCost(from_view.state.Corrected(p), to_view.state.Corrected(to.p), to.normal,
                        its_weight),
        coarse.ceres->loss.get(), coarse.state->poses[a].values, coarse.state->poses[b].values);
  };
  for (const Match& match : matches) {
    const CloudPoint &from = from_view.Cloud(match.from), &to = to_view.Cloud(match.to);
    if (from.use == BlockUse::kFit && to.use == BlockUse::kFit) add(from.p, to, weight);
  }
  if (problem.HasStructureTerms(a) && problem.HasStructureTerms(b)) return;
  // Where the structure does not hold a sensor, its silhouettes do: a convex edge also lies on
  // the face that only the other sensor sees, whose normal points across the silhouette.
  const Pose b_from_a =
      to_view.state.structure_from_sensor.inverse() * from_view.state.structure_from_sensor;
  for (const EdgePoint& edge : from_view.points->edge_points) {
    if (edge.use != BlockUse::kFit) continue;
    const Eigen::Vector3d p = b_from_a * from_view.state.Corrected(edge.p);
    // Just behind the edge, where the other face is nearer than the common one.
    const Eigen::Vector3d probe = p - b_from_a.linear() * edge.normal * kRoundTheCorner;
    const int j = to_view.points->Nearest(to_view.state.AsMeasured(probe),
                                          coarse.gates.overlap + kRoundTheCorner);
    if (j < 0) continue;
    const CloudPoint& to = to_view.Cloud(j);
    if (to.use != BlockUse::kFit) continue;
    if ((b_from_a.linear() * edge.outward).dot(to.normal) < kFacesOutward) continue;
    if (std::abs(to.normal.dot(p - to_view.state.Corrected(to.p))) > coarse.gates.overlap) continue;
    add(edge.p, to, weight * sigma / std::hypot(sigma, edge.sigma, kEdgeTolerance));
  }
}

void AddOverlapTerms(const Coarse& coarse, std::size_t a, std::size_t b) {
  const OverlapEnd view_a = coarse.problem.Overlap(a, *coarse.state),
                   view_b = coarse.problem.Overlap(b, *coarse.state);
  const SharedPoints shared =
      FindShared(view_a, view_b, coarse.gates.overlap, coarse.gates.min_cosine);
  if (!shared.IsPair(coarse.problem.setup.schedule.min_overlap)) return;
  AddMatches(coarse, a, b, view_a, view_b, shared.of_a);
  AddMatches(coarse, b, a, view_b, view_a, shared.of_b);
}

/// Standard deviation, m, of a sensor's points about the structure.
double MeasureSigma(const JointProblem& problem, const State& state, std::size_t i,
                    double side_gate) {
  const FrameState sensor = state.Frame(i);
  std::vector<double> distances;
  for (const SidePoint& point : problem.frames[i].points->side_points) {
    if (!LiesOnItsSide(state.Built(i), sensor, point, side_gate)) continue;
    const Eigen::Vector3d p = sensor.InStructure(point.p);
    distances.push_back((state.Built(i).SideOfLabel(point.label).ClosestPoint(p) - p).norm());
  }
  return std::max(kLeastScaleSigma, kMadToSigma * Median(std::move(distances)));
}

}  // namespace

Gates CoarseGates(int iteration) {
  const double shrink = std::pow(kShrink, iteration);
  return {std::max(kFirstSideGate * shrink, kLeastSideGate),
          std::max(kFirstOverlapGate * shrink, kLeastOverlapGate),
          std::cos(std::max(kFirstAngleGate * shrink, kLeastAngleGate) * M_PI / 180)};
}

State SolveCoarse(const JointProblem& problem, const std::vector<char>& held, State state) {
  std::vector<double> sigmas(problem.size(), kStartSigma);
  for (int iteration = 0; iteration < problem.setup.schedule.outer_iterations; ++iteration) {
    CeresProblem ceres;
    const Coarse coarse{problem, sigmas, CoarseGates(iteration), LeastScale(iteration),
                        &state,  &ceres};
    for (std::size_t i = 0; i < problem.size(); ++i) {
      double* pose = state.poses[i].values;
      ceres.problem->AddParameterBlock(pose, 7, ceres.manifold.get());
      ceres.problem->AddResidualBlock(new PosePriorCost(state.poses[i].ToPose(), 1, 1), nullptr,
                                      pose);
      if (held[i]) {
        ceres.problem->SetParameterBlockConstant(pose);
      } else if (problem.HasStructureTerms(i)) {
        AddStructureTerms(coarse, i);
      }
    }
    for (std::size_t a = 0; a < problem.size(); ++a) {
      for (std::size_t b = a + 1; b < problem.size(); ++b) {
        if (problem.OverlapCounts(a, b)) AddOverlapTerms(coarse, a, b);
      }
    }
    // The fine stage, which begins where this one ends, can do without it.
    if (!Minimise(problem.setup.schedule, ceres.problem.get()).usable) break;
    for (std::size_t i = 0; i < problem.size(); ++i) {
      if (problem.HasStructureTerms(i))
        sigmas[i] = MeasureSigma(problem, state, i, coarse.gates.side);
    }
  }
  return state;
}

}  // namespace volalign::refine_internal

#include "infer/refine/pair_overlap.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "core/base/parallel_for.h"
#include "core/base/statistics.h"
#include "core/geometry/visibility.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

constexpr double kOverlapGate = 2 * kRoughPose;  // m, of matched points
/// Error of a point from errors of the intrinsics, as a share of its distance from the optical
/// axis. The structure, in the middle of the frame, hardly shows them.
constexpr double kIntrinsicsError = 0.002;

/// One frame's part in a pair. Its errors at the matched points: the sum of their variances, m^2.
/// The cells of one correlation length that contain these points.
struct PairEnd {
  OverlapEnd view;
  const NoiseModel& noise;
  double variance = 0;
  std::set<std::pair<int, int>> cells = {};

  void Count(const Eigen::Vector3d& p) {
    const double sigma = PointSigma(noise.depth, p);
    variance += sigma * sigma;
    const Eigen::Vector2d at = p.head<2>() / p.z() / noise.depth.smooth_rad;
    cells.insert({static_cast<int>(std::floor(at.x())), static_cast<int>(std::floor(at.y()))});
  }
};

PairOverlap Measure(const JointProblem& problem, const std::vector<FrameObservations>& observed,
                    const State& state, std::size_t a, std::size_t b) {
  PairOverlap pair{a, b};
  PairEnd end_a{problem.Overlap(a, state), observed[a].noise};
  PairEnd end_b{problem.Overlap(b, state), observed[b].noise};
  const SharedPoints shared = FindShared(end_a.view, end_b.view, kOverlapGate, kOnePlane);
  if (!shared.IsPair(problem.setup.min_overlap)) return pair;
  std::vector<double> sizes;
  const Structure& structure = problem.model.structure();
  const Side floor = FloorOf(structure);
  const auto bounced = [&](const PairEnd& end, const Eigen::Vector3d& p) {
    if (end.noise.depth.bounce_m == 0) return 0.0;
    const Eigen::Vector3d q = end.view.state.InStructure(p);
    if (std::abs(q.y() - structure.FloorHeight()) > kRoughPose) return 0.0;
    return DiffuseMultipathShare(structure, floor, q,
                                 end.view.state.structure_from_sensor.translation(),
                                 end.noise.depth.bounce_reach_m);
  };
  const auto take = [&](PairEnd* from_end, PairEnd* to_end, const std::vector<Match>& matches,
                        std::vector<PairMatch>* taken) {
    for (const Match& match : matches) {
      const CloudPoint& from = from_end->view.Cloud(match.from);
      const CloudPoint& to = to_end->view.Cloud(match.to);
      const double sigma = std::hypot(PointSigma(from_end->noise.depth, from.p),
                                      PointSigma(to_end->noise.depth, to.p));
      if (sigma > kOverlapGate / 2) continue;
      const Eigen::Vector3d p = from_end->view.state.InStructure(from.p);
      if (DistanceToSurface(state.Built(a), p).distance < kOffStructure) continue;
      taken->push_back(
          {&from, &to, sigma, match.residual, bounced(*from_end, from.p), bounced(*to_end, to.p)});
      sizes.push_back(std::abs(match.residual) / sigma);
      from_end->Count(from.p);
      to_end->Count(to.p);
    }
  };
  take(&end_a, &end_b, shared.of_a, &pair.of_a);
  take(&end_b, &end_a, shared.of_b, &pair.of_b);
  if (sizes.empty()) return pair;
  // The number of independent residuals whose mean is as uncertain as that of these. Each sensor's
  // errors are independent from cell to cell.
  const auto of_mean = [](const PairEnd& end) {
    return end.variance / static_cast<double>(end.cells.size());
  };
  pair.cells = (end_a.variance + end_b.variance) / (of_mean(end_a) + of_mean(end_b));
  pair.excess = std::max(1.0, kMadToSigma * Quantile(std::move(sizes), 0.5));
  return pair;
}

/// n frames that see one place have n errors there, but n (n - 1) / 2 pairs. The pairs'
/// differences, squared and divided by their variances, sum to n / 2 times the same sum of the n
/// errors from their mean.
void CountOnce(std::vector<PairOverlap>* pairs) {
  using PointOfFrame = std::pair<std::size_t, const CloudPoint*>;
  std::map<PointOfFrame, int> others;  // that see it
  const auto for_each = [](const PairOverlap& pair, const auto& visit) {
    for (const PairMatch& match : pair.of_a) visit(PointOfFrame(pair.a, match.point));
    for (const PairMatch& match : pair.of_b) visit(PointOfFrame(pair.b, match.point));
  };
  for (const PairOverlap& pair : *pairs)
    for_each(pair, [&](const PointOfFrame& point) { ++others[point]; });
  for (PairOverlap& pair : *pairs) {
    double sum = 0;
    for_each(pair, [&](const PointOfFrame& point) { sum += 2.0 / (1 + others[point]); });
    const std::size_t count = pair.of_a.size() + pair.of_b.size();
    if (count > 0) pair.cells *= sum / static_cast<double>(count);
  }
}

}  // namespace

double PointSigma(const DepthErrorModel& errors, const Eigen::Vector3d& p) {
  return std::hypot(std::max(errors.Smooth(p.z()), kDepthStep),
                    kIntrinsicsError * p.head<2>().norm());
}

std::vector<PairOverlap> FindOverlaps(const JointProblem& problem,
                                      const std::vector<FrameObservations>& observed,
                                      const std::vector<char>& fixed, const State& state) {
  std::vector<PairOverlap> pairs;
  for (std::size_t a = 0; a < problem.size(); ++a) {
    for (std::size_t b = a + 1; b < problem.size(); ++b) {
      if (!fixed[a] && !fixed[b] && problem.OverlapCounts(a, b)) pairs.push_back({a, b});
    }
  }
  ParallelFor(pairs.size(), problem.setup.threads, [&](std::size_t k) {
    pairs[k] = Measure(problem, observed, state, pairs[k].a, pairs[k].b);
  });
  CountOnce(&pairs);
  return pairs;
}

}  // namespace volalign::refine_internal

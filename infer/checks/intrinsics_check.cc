#include "infer/checks/intrinsics_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

/// Focal lengths are tried in equal ratios, so many each way, up to this factor.
constexpr int kFocalSteps = 5;
constexpr double kMaxFocalFactor = 1.4;
/// Other intrinsics count if labels and depth agree with the structure by at least the first, and
/// by the second more than with those given. The third is the least relative change of the focal
/// length, or change of the principal point in focal lengths.
constexpr double kLeastScore = 0.8, kLeastGain = 0.08, kLeastChange = 0.05;

/// A frame that scores intrinsics, with its labels decimated.
struct LabelledDepth {
  const SensorView& view;
  int stride = 1;
  SegmentationResult segmentation;
};

double Score(const LabelledDepth& frame, const Intrinsics& intrinsics, const Structure& structure,
             const InitialPoseOptions& initial) {
  const SensorView view =
      Decimate(MakeSensorView(frame.view.depth, intrinsics, frame.view.errors), frame.stride);
  const InitialPose pose = EstimateInitialPose(view, frame.segmentation, structure, initial);
  return pose.found ? pose.agreement.score() : 0;
}

Intrinsics WithFocalFactor(Intrinsics intrinsics, double factor) {
  intrinsics.fx *= factor;
  intrinsics.fy *= factor;
  return intrinsics;
}

/// Place of the peak of the parabola through three values at -1, 0 and 1; the middle one is the
/// largest.
double ParabolaPeak(double before, double middle, double after) {
  const double bend = before - 2 * middle + after;
  return bend < 0 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0;
}

/// The factor on the focal lengths that scores best, and its score. `score`: of a factor.
template <class ScoreOfFactor>
std::pair<double, double> BestFocalFactor(double given_score, const ScoreOfFactor& score) {
  const double step = std::log(kMaxFocalFactor) / kFocalSteps;
  std::vector<double> scores;
  for (int k = -kFocalSteps; k <= kFocalSteps; ++k)
    scores.push_back(k == 0 ? given_score : score(std::exp(k * step)));
  const auto peak =
      static_cast<int>(std::max_element(scores.begin(), scores.end()) - scores.begin());
  double at = peak - kFocalSteps, best = scores[static_cast<std::size_t>(peak)];
  if (peak > 0 && peak < 2 * kFocalSteps) {
    const double shift = ParabolaPeak(scores[static_cast<std::size_t>(peak) - 1], best,
                                      scores[static_cast<std::size_t>(peak) + 1]);
    const double between = score(std::exp((at + shift) * step));
    if (between > best) {
      at += shift;
      best = between;
    }
  }
  return {std::exp(at * step), best};
}

}  // namespace

std::optional<BetterIntrinsics> FindBetterIntrinsics(const SensorView& view,
                                                     const Intrinsics& given,
                                                     const SegmentationResult& segmentation,
                                                     const Structure& structure,
                                                     const InitialPoseOptions& initial) {
  const int stride = StrideForRays(view.depth.size(), kCoarseRays);
  const LabelledDepth frame{view, stride, Decimate(segmentation, stride)};
  const auto score = [&](const Intrinsics& intrinsics) {
    return Score(frame, intrinsics, structure, initial);
  };
  BetterIntrinsics best;
  best.given_score = score(given);
  const auto [factor, focal_score] =
      BestFocalFactor(best.given_score, [&](double f) { return score(WithFocalFactor(given, f)); });
  best.score = focal_score;
  best.intrinsics = WithFocalFactor(given, factor);
  best.size = std::abs(factor - 1);
  best.change = fmt::format("fx = {:.1f}, fy = {:.1f}", best.intrinsics.fx, best.intrinsics.fy);

  for (const auto& [cx, cy] : {std::pair{given.cy, given.cx},
                               std::pair{(given.width - 1) / 2.0, (given.height - 1) / 2.0}}) {
    const double shift = std::hypot((cx - given.cx) / given.fx, (cy - given.cy) / given.fy);
    if (shift < kLeastChange) continue;
    Intrinsics moved = given;
    moved.cx = cx;
    moved.cy = cy;
    const double moved_score = score(moved);
    if (moved_score <= best.score) continue;
    best = {moved, fmt::format("cx = {:.1f}, cy = {:.1f}", cx, cy), best.given_score, moved_score,
            shift};
  }
  if (best.score < kLeastScore || best.score < best.given_score + kLeastGain ||
      best.size < kLeastChange)
    return std::nullopt;
  return best;
}

}  // namespace volalign

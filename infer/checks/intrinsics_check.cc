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

/// Place of the peak of the parabola through three values at -1, 0 and 1; the middle one is the
/// largest.
double ParabolaPeak(double before, double middle, double after) {
  const double bend = before - 2 * middle + after;
  return bend < 0 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0;
}

}  // namespace

std::optional<BetterIntrinsics> FindBetterIntrinsics(const SensorView& view,
                                                     const Intrinsics& given,
                                                     const SegmentationResult& segmentation,
                                                     const Structure& structure,
                                                     const InitialPoseOptions& initial) {
  const int stride = StrideForRays(view.depth.size(), kCoarseRays);
  const LabelledDepth frame{view, stride, Decimate(segmentation, stride)};
  BetterIntrinsics best;
  best.given_score = best.score = Score(frame, given, structure, initial);
  const auto consider = [&](const Intrinsics& other, const std::string& change, double size) {
    const double score = Score(frame, other, structure, initial);
    if (score > best.score) best = {other, change, best.given_score, score, size};
    return score;
  };
  const auto consider_focal = [&](double steps) {
    const double factor = std::pow(kMaxFocalFactor, steps / kFocalSteps);
    Intrinsics other = given;
    other.fx *= factor;
    other.fy *= factor;
    return consider(other, fmt::format("fx = {:.1f}, fy = {:.1f}", other.fx, other.fy),
                    std::abs(factor - 1));
  };
  std::vector<double> scores;
  for (int k = -kFocalSteps; k <= kFocalSteps; ++k)
    scores.push_back(k == 0 ? best.given_score : consider_focal(k));
  const auto peak = std::max_element(scores.begin(), scores.end());
  if (peak != scores.begin() && peak + 1 != scores.end())
    consider_focal(static_cast<double>(peak - scores.begin()) - kFocalSteps +
                   ParabolaPeak(peak[-1], peak[0], peak[1]));
  for (const auto& [cx, cy] : {std::pair{given.cy, given.cx},
                               std::pair{(given.width - 1) / 2.0, (given.height - 1) / 2.0}}) {
    const double shift = std::hypot((cx - given.cx) / given.fx, (cy - given.cy) / given.fy);
    if (shift < kLeastChange) continue;
    Intrinsics moved = given;
    moved.cx = cx;
    moved.cy = cy;
    consider(moved, fmt::format("cx = {:.1f}, cy = {:.1f}", cx, cy), shift);
  }
  if (best.score < kLeastScore || best.score < best.given_score + kLeastGain ||
      best.size < kLeastChange)
    return std::nullopt;
  return best;
}

}  // namespace volalign

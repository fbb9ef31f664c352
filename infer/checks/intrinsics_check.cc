#include "infer/checks/intrinsics_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

constexpr double kMinScore = 0.8, kMinGain = 0.08, kMinSize = 0.05;

class Search {
 public:
  Search(const DepthImage& depth, const SegmentationResult& segmentation,
         const Structure& structure, const InitialPoseOptions& options)
      : depth_(depth), structure_(structure), options_(options) {
    stride_ = std::max(
        1, static_cast<int>(std::floor(std::sqrt(static_cast<double>(depth.size()) / 10000))));
    labels_ = {DecimateImage(segmentation.labels, stride_),
               DecimateImage(segmentation.confidence, stride_)};
  }

  double Score(const Intrinsics& intrinsics) const {
    const SensorView view = Decimate(MakeSensorView(depth_, intrinsics), stride_);
    const InitialPose pose = EstimateInitialPose(view, labels_, structure_, options_);
    return pose.found ? pose.agreement.score() : 0;
  }

 private:
  const DepthImage& depth_;
  const Structure& structure_;
  const InitialPoseOptions& options_;
  int stride_ = 1;
  SegmentationResult labels_;
};

Intrinsics WithFocal(Intrinsics intrinsics, double factor) {
  intrinsics.fx *= factor;
  intrinsics.fy *= factor;
  return intrinsics;
}

Intrinsics WithPrincipalPoint(Intrinsics intrinsics, double cx, double cy) {
  intrinsics.cx = cx;
  intrinsics.cy = cy;
  return intrinsics;
}

}  // namespace

std::optional<BetterIntrinsics> FindBetterIntrinsics(const DepthImage& depth,
                                                     const Intrinsics& given,
                                                     const SegmentationResult& segmentation,
                                                     const Structure& structure,
                                                     const InitialPoseOptions& options) {
  const Search search(depth, segmentation, structure, options);
  BetterIntrinsics best;
  best.given_score = search.Score(given);

  constexpr int kSteps = 5;  // each way
  const double step = std::log(1.4) / kSteps;
  std::vector<double> scores;
  for (int k = -kSteps; k <= kSteps; ++k) {
    scores.push_back(k == 0 ? best.given_score
                            : search.Score(WithFocal(given, std::exp(k * step))));
  }
  const auto peak =
      static_cast<int>(std::max_element(scores.begin(), scores.end()) - scores.begin());
  double at = peak - kSteps;
  best.score = scores[static_cast<std::size_t>(peak)];
  if (peak > 0 && peak < 2 * kSteps) {
    // The parabola through the peak and its neighbours.
    const double before = scores[static_cast<std::size_t>(peak) - 1];
    const double after = scores[static_cast<std::size_t>(peak) + 1];
    const double bend = before - 2 * best.score + after;
    const double shift = bend < 0 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0;
    const double score = search.Score(WithFocal(given, std::exp((at + shift) * step)));
    if (score > best.score) {
      at += shift;
      best.score = score;
    }
  }
  best.intrinsics = WithFocal(given, std::exp(at * step));
  best.size = std::abs(std::exp(at * step) - 1);
  best.change = fmt::format("fx = {:.1f}, fy = {:.1f}", best.intrinsics.fx, best.intrinsics.fy);

  for (const auto& [cx, cy] : {std::pair{given.cy, given.cx},
                               std::pair{(given.width - 1) / 2.0, (given.height - 1) / 2.0}}) {
    const double shift = std::hypot((cx - given.cx) / given.fx, (cy - given.cy) / given.fy);
    if (shift < kMinSize) continue;
    const Intrinsics moved = WithPrincipalPoint(given, cx, cy);
    const double score = search.Score(moved);
    if (score <= best.score) continue;
    best.score = score;
    best.intrinsics = moved;
    best.size = shift;
    best.change = fmt::format("cx = {:.1f}, cy = {:.1f}", cx, cy);
  }
  if (best.score < kMinScore || best.score < best.given_score + kMinGain || best.size < kMinSize)
    return std::nullopt;
  return best;
}

}  // namespace volalign

#include "infer/view/network_frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Focal lengths beyond the trained range by up to this factor count as within it.
constexpr double kFocalSlack = 1.02;
/// Shortest side for the network's five resolutions, px.
constexpr int kMinNetworkSide = 16;
/// Depths that differ by no more than this belong to one surface, m.
constexpr float kSameSurface = kRoughPose;

/// Frame pixel in the middle of network pixel i, and the network pixel over frame pixel i.
int FramePixel(int i, double scale, int size) {
  return std::clamp(static_cast<int>((i + 0.5) * scale), 0, size - 1);
}
int NetworkPixel(int i, double scale, int size) {
  return std::clamp(static_cast<int>((i + 0.5) / scale), 0, size - 1);
}

}  // namespace

NetworkFrame PlanNetworkFrame(const Intrinsics& intrinsics, std::pair<double, double> focal_px) {
  const double focal = (intrinsics.fx + intrinsics.fy) / 2;
  const double low = focal_px.first / kFocalSlack, high = focal_px.second * kFocalSlack;
  double scale = 1;
  if (focal < low || focal > high) {
    scale = focal / std::sqrt(focal_px.first * focal_px.second);
    const double whole = std::round(scale);
    if (whole >= 1 && focal / whole >= low && focal / whole <= high) scale = whole;
  }
  NetworkFrame frame;
  frame.scale = scale;
  frame.width = std::max(1, static_cast<int>(std::lround(intrinsics.width / scale)));
  frame.height = std::max(1, static_cast<int>(std::lround(intrinsics.height / scale)));
  if (std::min(frame.width, frame.height) < kMinNetworkSide) {
    throw DataError(fmt::format(
        "a {}x{} frame with a focal length of {:.1f} px becomes {}x{} for a network trained at "
        "{:.1f} to {:.1f} px. It needs {} px or more per side; check the intrinsics",
        intrinsics.width, intrinsics.height, focal, frame.width, frame.height, focal_px.first,
        focal_px.second, kMinNetworkSide));
  }
  return frame;
}

DepthImage ResampleDepth(const DepthImage& depth, const NetworkFrame& frame) {
  if (frame.scale == 1) return depth;
  DepthImage small(frame.width, frame.height);
  for (int v = 0; v < frame.height; ++v) {
    const int from_v = FramePixel(v, frame.scale, depth.height());
    for (int u = 0; u < frame.width; ++u) {
      small(u, v) = depth(FramePixel(u, frame.scale, depth.width()), from_v);
    }
  }
  return small;
}

SegmentationResult RestoreSegmentation(const DepthImage& depth, const DepthImage& small_depth,
                                       const LabelImage& small_labels,
                                       const Image<float>& small_confidence,
                                       const NetworkFrame& frame) {
  SegmentationResult result{LabelImage(depth.width(), depth.height()),
                            Image<float>(depth.width(), depth.height())};
  for (int v = 0; v < depth.height(); ++v) {
    const int near_v = NetworkPixel(v, frame.scale, frame.height);
    for (int u = 0; u < depth.width(); ++u) {
      const float z = depth(u, v);
      if (!(z > 0)) continue;
      const int near_u = NetworkPixel(u, frame.scale, frame.width);
      int best_u = near_u, best_v = near_v;
      float best = std::abs(small_depth(near_u, near_v) - z);
      if (best > kSameSurface) {
        for (int dv = -1; dv <= 1; ++dv) {
          for (int du = -1; du <= 1; ++du) {
            if (!small_depth.Contains(near_u + du, near_v + dv)) continue;
            const float difference = std::abs(small_depth(near_u + du, near_v + dv) - z);
            if (difference < best) {
              best = difference;
              best_u = near_u + du;
              best_v = near_v + dv;
            }
          }
        }
      }
      result.labels(u, v) = small_labels(best_u, best_v);
      result.confidence(u, v) = small_confidence(best_u, best_v);
    }
  }
  return result;
}

}  // namespace volalign

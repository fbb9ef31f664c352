#pragma once

#include <optional>
#include <string>

#include "core/camera.h"
#include "core/structure.h"
#include "infer/pose/initial_pose.h"
#include "infer/view/segmenter.h"

namespace volalign {

/// Other intrinsics than those given, with which a frame fits the structure clearly better.
struct BetterIntrinsics {
  Intrinsics intrinsics;
  std::string change;      ///< "fx = 252.2, fy = 252.2", "cx = 160, cy = 90"
  double given_score = 0;  ///< Agreement::score of the best pose, labels and depth
  double score = 0;
  /// Largest relative change of a focal length, or of the principal point in focal lengths.
  double size = 0;
};

/// Tries focal lengths from 0.7 to 1.4 times those given, the principal point with its coordinates
/// exchanged and in the image's middle, each with a new initial pose on every third pixel or so.
/// Nothing unless one scores at least 0.8, 0.08 more than as given, and differs by 5 %. Costs some
/// 15 initial poses: for a frame that fits badly.
std::optional<BetterIntrinsics> FindBetterIntrinsics(const DepthImage& depth,
                                                     const Intrinsics& given,
                                                     const SegmentationResult& segmentation,
                                                     const Structure& structure,
                                                     const InitialPoseOptions& options);

}  // namespace volalign

#pragma once

#include <optional>
#include <string>

#include "core/geometry/camera.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/view/segmentation.h"

namespace volalign {

/// Other intrinsics than those given, with which a frame fits the structure clearly better.
struct BetterIntrinsics {
  Intrinsics intrinsics;
  std::string change;      ///< "fx = 252.2, fy = 252.2" or "cx = 160.0, cy = 90.0"
  double given_score = 0;  ///< Agreement::score of the best pose with the intrinsics given
  double score = 0;        ///< the same with these
  /// Relative change of the focal length, or change of the principal point in focal lengths.
  double size = 0;
};

/// Tries focal lengths from 1 / 1.4 to 1.4 times those given, and the principal point with its
/// coordinates exchanged or in the image's middle. Each gets a new initial pose on about
/// kCoarseRays rays, with the view's depths and their errors. Nothing unless the best of them fits
/// clearly better. It costs some 15 initial poses, so it is for frames that fit badly.
std::optional<BetterIntrinsics> FindBetterIntrinsics(const SensorView& view,
                                                     const Intrinsics& given,
                                                     const SegmentationResult& segmentation,
                                                     const Structure& structure,
                                                     const InitialPoseOptions& initial);

}  // namespace volalign

#pragma once

#include <utility>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "infer/view/segmentation.h"

namespace volalign {

/// How a frame is presented to a network that was trained at focal lengths from focal_px.first to
/// focal_px.second only: width and height are divided by `scale`, by nearest neighbour; depths are
/// never averaged.
struct NetworkFrame {
  int width = 0, height = 0;  ///< px, before the image is turned
  double scale = 1;           ///< frame pixels per network pixel
};

/// Chooses scale 1 for a focal length within the range, or beyond it by at most 2 %; else the whole
/// number that brings it there; else the ratio to the range's geometric mean. Throws DataError for
/// a frame that would be smaller than 16 px.
NetworkFrame PlanNetworkFrame(const Intrinsics& intrinsics, std::pair<double, double> focal_px);

DepthImage ResampleDepth(const DepthImage& depth, const NetworkFrame& frame);

/// Labels and confidences of the network's frame back at full size. Every pixel with depth takes
/// those of the nearest network pixel, or, where that one lies on another surface (depths differ by
/// over 3 cm), those of the one of its 8 neighbours whose depth is most alike. `small_depth` is
/// what ResampleDepth made.
SegmentationResult RestoreSegmentation(const DepthImage& depth, const DepthImage& small_depth,
                                       const LabelImage& small_labels,
                                       const Image<float>& small_confidence,
                                       const NetworkFrame& frame);

/// A map of the network's frame that has nothing to do with depth, back at the frame's size by
/// nearest neighbour.
Image<float> RestoreMap(const Image<float>& small, int width, int height,
                        const NetworkFrame& frame);

}  // namespace volalign

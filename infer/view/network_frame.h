#pragma once

#include <utility>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "infer/view/segmentation.h"

namespace volalign {

/// How a frame is presented to a network that was trained at focal lengths from focal_px.first to
/// focal_px.second only. Width and height are divided by `scale`, by nearest neighbour: depths are
/// never averaged.
struct NetworkFrame {
  int width = 0, height = 0;  ///< px, before the image is turned
  double scale = 1;           ///< frame pixels per network pixel
};

/// Chooses the scale. It is 1 for a focal length within the range, or beyond it by at most 2 %.
/// Else it is the whole number that brings it there, or else the ratio to the range's geometric
/// mean. Throws DataError if the frame would be smaller than 16 px.
NetworkFrame PlanNetworkFrame(const Intrinsics& intrinsics, std::pair<double, double> focal_px);

DepthImage ResampleDepth(const DepthImage& depth, const NetworkFrame& frame);

/// Brings labels and confidences of the network's frame back to full size. Every pixel with depth
/// takes those of the nearest network pixel. If that one lies on another surface (depths differ by
/// over 3 cm), the most similar depth of its 8 neighbours decides. `small_depth` is the result of
/// ResampleDepth.
SegmentationResult RestoreSegmentation(const DepthImage& depth, const DepthImage& small_depth,
                                       const LabelImage& small_labels,
                                       const Image<float>& small_confidence,
                                       const NetworkFrame& frame);

}  // namespace volalign

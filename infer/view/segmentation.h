#pragma once

#include "core/base/image.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Least probability at which a pixel's label counts.
inline constexpr double kLeastConfidence = 0.5;

/// Labels of one frame, in the frame's own size and orientation.
struct SegmentationResult {
  LabelImage labels;        ///< 0 where there is no depth
  Image<float> confidence;  ///< probability of the label, 0 where there is no depth

  /// The label that counts at a pixel, or 0.
  int LabelAt(int u, int v) const {
    return confidence(u, v) >= kLeastConfidence ? labels(u, v) : 0;
  }
};

/// Every `stride`-th pixel of every `stride`-th row: the same pixels as Decimate takes of a
/// SensorView.
inline SegmentationResult Decimate(const SegmentationResult& segmentation, int stride) {
  if (stride <= 1) return segmentation;
  return {DecimateImage(segmentation.labels, stride),
          DecimateImage(segmentation.confidence, stride)};
}

}  // namespace volalign

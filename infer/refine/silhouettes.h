#pragma once

#include <cstddef>
#include <vector>

#include "infer/refine/sensor_points.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A view and the sides that its pixels confidently show.
struct ConfidentSides {
  const SensorView& view;
  const SegmentationResult& segmentation;
  std::size_t classes;

  /// The side that a pixel with depth confidently shows, or 0.
  int At(int u, int v) const {
    const int label = segmentation.LabelAt(u, v);
    return static_cast<std::size_t>(label) < classes && view.depth(u, v) > 0 ? label : 0;
  }
};

/// Searches from every pixel of a side whose neighbour is not on it, across that border to where
/// the side's surface ends and a depth behind it was measured, across a gap of a few pixels at
/// most.
std::vector<EdgePoint> FindSilhouettes(const ConfidentSides& sides);

}  // namespace volalign

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
  double min_confidence;

  /// The side that a pixel with depth confidently shows, or 0.
  int At(int u, int v) const {
    const int label = segmentation.labels(u, v);
    const bool usable = label > 0 && static_cast<std::size_t>(label) < classes &&
                        view.depth(u, v) > 0 && segmentation.confidence(u, v) >= min_confidence;
    return usable ? label : 0;
  }
};

struct Silhouettes {
  /// The depth behind the edge was measured, across a gap of a few pixels at most.
  std::vector<EdgePoint> two_sided;
  /// A wider gap follows, or nothing up to the border of the picture. The depth of the side itself
  /// may be missing. So these are only points at which the side ends along a straight line. A hole
  /// (the same plane goes on behind it) and a hidden part (the next depth is nearer) do not count.
  /// Neither does the border of the picture with the band that some sensors leave empty. Only views
  /// with few two-sided points along the same image axis have them.
  std::vector<EdgePoint> one_sided;
};

/// Searches from every pixel of a side whose neighbour is not on it, across that border to where
/// the side's surface ends.
Silhouettes FindSilhouettes(const ConfidentSides& sides);

}  // namespace volalign

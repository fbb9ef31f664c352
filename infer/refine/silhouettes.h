#pragma once

#include <cstddef>
#include <vector>

#include "infer/refine/sensor_points.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A view whose pixels are asked for the side that they show.
struct ConfidentSides {
  const SensorView& view;
  const SegmentationResult& segmentation;
  std::size_t classes;
  double min_confidence;

  /// The side that a pixel is confidently on and has depth for, or 0.
  int At(int u, int v) const {
    const int label = segmentation.labels(u, v);
    const bool usable = label > 0 && static_cast<std::size_t>(label) < classes &&
                        view.depth(u, v) > 0 && segmentation.confidence(u, v) >= min_confidence;
    return usable ? label : 0;
  }
};

struct Silhouettes {
  /// Where the depth behind the edge was measured, across a gap of a few pixels at most.
  std::vector<EdgePoint> two_sided;
  /// Where a wider gap follows, or nothing at all up to the border of the picture. The depth of the
  /// side itself may be what is missing. So these are only points at which the side ends along a
  /// straight line. No such end are a hole (the same plane goes on behind it), what is hidden (the
  /// next depth is nearer), and the border of the picture with the band along it that some sensors
  /// leave empty. Only in views that have few two-sided ones along the same image axis.
  std::vector<EdgePoint> one_sided;
};

/// From every pixel of a side whose neighbour is none of it, across that border to where the side's
/// surface ends.
Silhouettes FindSilhouettes(const ConfidentSides& sides);

}  // namespace volalign

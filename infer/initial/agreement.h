#pragma once

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/depth/surface_tolerance.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Agreement of a pose with a frame. The counts compare the structure as seen from the pose
/// (core/geometry/visibility.h, CastView) with the measured depths and the predicted labels, pixel
/// by pixel.
struct Agreement {
  int visible = 0;     ///< pixels with depth where the structure would be seen
  int explained = 0;   ///< visible pixels whose measured point lies on the structure's surface
  int same_label = 0;  ///< explained pixels whose label is the predicted one
  int either = 0;      ///< pixels with a side label, as predicted or as seen from the pose
  double miou = 0;     ///< mean IoU over classes (core/geometry/metrics.h) of these labels

  double explained_share() const { return Ratio(explained, visible); }
  /// Intersection over union of "side k, at the right depth": 1 for a perfect pose and perfect
  /// labels.
  double score() const { return Ratio(same_label, either); }

 private:
  static double Ratio(int a, int b) { return b > 0 ? static_cast<double>(a) / b : 0.0; }
};

/// Labels below kLeastConfidence count for `miou` alone. `tolerance`: largest distance from the
/// surface at which a point counts as explained.
Agreement CompareWithView(const SensorView& view, const SegmentationResult& segmentation,
                          const Structure& structure, const Pose& structure_from_sensor,
                          const SurfaceTolerance& tolerance);

/// Labels as seen from a pose. A pixel gets the label of the side that the structure shows there,
/// with confidence 1, if its point lies within `tolerance` of that side. All others get 0. If the
/// pose is right to a pixel or two, these labels are complete and end where the surfaces do. A
/// network's labels are not and do not.
SegmentationResult LabelsFromPose(const SensorView& view, const Structure& structure,
                                  const Pose& structure_from_sensor,
                                  const SurfaceTolerance& tolerance);

}  // namespace volalign

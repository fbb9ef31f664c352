#include "infer/initial/agreement.h"

#include <cmath>

#include "core/geometry/metrics.h"
#include "core/geometry/visibility.h"
#include "infer/initial/side_patch.h"

namespace volalign {

Agreement CompareWithView(const SensorView& view, const SegmentationResult& segmentation,
                          const Structure& structure, const Pose& structure_from_sensor,
                          const SurfaceTolerance& tolerance) {
  const ExpectedView expected = CastView(structure, view.rays, structure_from_sensor);
  Agreement agreement;
  view.VisitMeasured(1, [&](int u, int v) {
    const double measured = view.depth(u, v);
    const double tolerance_m = tolerance(measured);
    const double expected_m = expected.depth(u, v);
    const int predicted = segmentation.LabelAt(u, v);
    const bool labelled = predicted > 0 && predicted < structure.num_classes();
    bool explained = false;
    if (expected_m > 0) {
      ++agreement.visible;
      // Depth changes fast along a grazing ray; the point's distance to the surface does not.
      const double gap =
          std::abs(measured - expected_m) <= tolerance_m
              ? 0
              : DistanceToSurface(structure, structure_from_sensor * view.Point(u, v)).distance;
      explained = gap <= tolerance_m;
      if (explained) ++agreement.explained;
    }
    if (labelled || expected.labels(u, v) > 0) {
      ++agreement.either;
      if (explained && predicted == expected.labels(u, v)) ++agreement.same_label;
    }
  });
  MiouOptions options;
  options.num_classes = structure.num_classes();
  agreement.miou = MeanIou(segmentation.labels, expected.labels, view.depth, options);
  return agreement;
}

SegmentationResult LabelsFromPose(const SensorView& view, const Structure& structure,
                                  const Pose& structure_from_sensor,
                                  const SurfaceTolerance& tolerance) {
  SegmentationResult result;
  result.labels = CastView(structure, view.rays, structure_from_sensor).labels;
  result.confidence = Image<float>(view.width(), view.height(), 0.0f);
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      std::uint8_t& label = result.labels(u, v);
      if (label == 0) continue;
      const Eigen::Vector3d p = structure_from_sensor * view.Point(u, v);
      if (view.depth(u, v) > 0 && (structure.SideOfLabel(label).ClosestPoint(p) - p).norm() <=
                                      tolerance(view.depth(u, v))) {
        result.confidence(u, v) = 1;
      } else {
        label = 0;
      }
    }
  }
  return result;
}

}  // namespace volalign

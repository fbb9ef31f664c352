#include "infer/pose/agreement.h"

#include <cmath>

#include "core/metrics.h"
#include "core/visibility.h"

namespace volalign {

Agreement CompareWithView(const SensorView& view, const SegmentationResult& segmentation,
                          const Structure& structure, const Pose& structure_from_sensor,
                          double min_confidence, double tolerance_m) {
  const StructureView model = CastView(structure, view.rays, structure_from_sensor);
  Agreement agreement;
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const double measured = view.depth(u, v);
      if (!(measured > 0)) continue;
      const double expected = model.depth(u, v);
      const Eigen::Vector3d p = structure_from_sensor * view.Point(u, v);
      const int predicted =
          segmentation.confidence(u, v) >= min_confidence ? segmentation.labels(u, v) : 0;
      const bool labelled = predicted > 0 && predicted < structure.num_classes();
      bool explained = false;
      if (expected > 0) {
        ++agreement.visible;
        // Depth changes fast along a grazing ray; the point's distance to the surface does not.
        const double gap = std::abs(measured - expected) <= tolerance_m
                               ? 0
                               : DistanceToSurface(structure, p).distance;
        explained = gap <= tolerance_m;
        if (explained) {
          ++agreement.explained;
        } else if (measured < expected) {
          ++agreement.occluded;
        } else {
          ++agreement.see_through;
        }
      }
      if (labelled) {
        ++agreement.labelled;
        if ((structure.SideOfLabel(predicted).ClosestPoint(p) - p).norm() <= tolerance_m) {
          ++agreement.on_own_side;
        }
      }
      if (labelled || model.labels(u, v) > 0) {
        ++agreement.either;
        if (explained && predicted == model.labels(u, v)) ++agreement.same_label;
      }
    }
  }
  MiouOptions options;
  options.num_classes = structure.num_classes();
  agreement.miou = MeanIou(segmentation.labels, model.labels, view.depth, options);
  return agreement;
}

SegmentationResult LabelsFromPose(const SensorView& view, const Structure& structure,
                                  const Pose& structure_from_sensor, double tolerance_m) {
  SegmentationResult result;
  result.labels = CastView(structure, view.rays, structure_from_sensor).labels;
  result.confidence = Image<float>(view.width(), view.height(), 0.0f);
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      std::uint8_t& label = result.labels(u, v);
      if (label == 0) continue;
      const Eigen::Vector3d p = structure_from_sensor * view.Point(u, v);
      if (view.depth(u, v) > 0 &&
          (structure.SideOfLabel(label).ClosestPoint(p) - p).norm() <= tolerance_m) {
        result.confidence(u, v) = 1;
      } else {
        label = 0;
      }
    }
  }
  return result;
}

DepthOverlap MeasureOverlap(const SensorView& view, const SegmentationResult& segmentation,
                            const Structure& structure, const Pose& structure_from_sensor,
                            double min_confidence) {
  const StructureView model = CastView(structure, view.rays, structure_from_sensor);
  DepthOverlap overlap;
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const double measured = view.depth(u, v), expected = model.depth(u, v);
      if (!(measured > 0)) continue;
      const bool labelled =
          segmentation.labels(u, v) > 0 && segmentation.confidence(u, v) >= min_confidence;
      const bool near =
          (expected > 0 || labelled) &&
          DistanceToSurface(structure, structure_from_sensor * view.Point(u, v)).distance <=
              kInitialTolerance;
      if (expected > 0 && near) ++overlap.both;
      if (labelled || (expected > 0 && (near || measured > expected))) ++overlap.either;
    }
  }
  return overlap;
}

}  // namespace volalign

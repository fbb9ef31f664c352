#include "infer/initial/relabel.h"

#include <cstdint>

#include "infer/initial/agreement.h"

namespace volalign {

namespace {

/// The side of a label that lies nearest to a point.
struct NearestLabel {
  std::uint8_t label;
  float confidence;
  double distance;  // m
};

}  // namespace

SegmentationResult Relabelled(SegmentationResult segmentation, const StructureAlias& alias) {
  for (std::uint8_t& label : segmentation.labels) {
    label = label < alias.label_after.size() ? alias.label_after[label] : std::uint8_t{0};
  }
  return segmentation;
}

void ReconcileLabels(const SensorView& view, const Structure& structure,
                     const std::vector<StructureAlias>& aliases, const Pose& structure_from_sensor,
                     const std::vector<const SegmentationResult*>& others, double min_confidence,
                     SegmentationResult* segmentation) {
  std::vector<const SegmentationResult*> sources{segmentation};
  sources.insert(sources.end(), others.begin(), others.end());
  const SurfaceTolerance tolerance = SurfaceTolerance::AtRoughPose(view.errors);
  view.VisitMeasured(1, [&](int u, int v) {
    const Eigen::Vector3d p = structure_from_sensor * view.Point(u, v);
    const double farthest = tolerance(view.depth(u, v));
    const auto distance = [&](std::uint8_t label) {
      return label == 0 || label >= structure.num_classes()
                 ? farthest
                 : (structure.SideOfLabel(label).ClosestPoint(p) - p).norm();
    };
    if (distance(segmentation->labels(u, v)) < farthest) return;
    NearestLabel nearest{0, 0, farthest};
    for (const SegmentationResult* source : sources) {
      const std::uint8_t label = source->labels(u, v);
      const float confidence = source->confidence(u, v);
      if (label == 0 || !(confidence >= min_confidence)) continue;
      const auto consider = [&](std::uint8_t other) {
        const double d = distance(other);
        if (d < nearest.distance) nearest = {other, confidence, d};
      };
      consider(label);
      for (const StructureAlias& alias : aliases) {
        if (label < alias.label_after.size()) consider(alias.label_after[label]);
      }
    }
    if (nearest.label == 0) return;
    segmentation->labels(u, v) = nearest.label;
    segmentation->confidence(u, v) = nearest.confidence;
  });
}

}  // namespace volalign

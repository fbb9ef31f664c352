#include "infer/initial/paper_pose.h"

#include <Eigen/Core>
#include <vector>

#include "core/geometry/procrustes.h"

namespace volalign {

InitialPose EstimatePaperPose(const SensorView& view, const SegmentationResult& segmentation,
                              const Structure& structure, const InitialPoseOptions& options) {
  const auto classes = static_cast<std::size_t>(structure.num_classes());
  std::vector<Eigen::Vector3d> sums(classes, Eigen::Vector3d::Zero());
  std::vector<int> counts(classes, 0);
  view.VisitMeasured(1, [&](int u, int v) {
    const std::size_t label = segmentation.labels(u, v);
    if (label == 0 || label >= classes) return;
    if (segmentation.confidence(u, v) < options.patch.min_confidence) return;
    sums[label] += view.Point(u, v);
    ++counts[label];
  });
  std::vector<Eigen::Vector3d> source, target;
  for (std::size_t label = 1; label < classes; ++label) {
    if (counts[label] < options.patch.min_pixels) continue;
    source.push_back(sums[label] / counts[label]);
    target.push_back(structure.SideOfLabel(static_cast<int>(label)).centre);
  }
  InitialPose result;
  result.patches = CollectPatches(view, segmentation, structure, options.patch);
  if (source.size() < 3 || !(SecondSingularValue(target) > kMinSecondSingularValue)) return result;
  result.found = true;
  result.structure_from_sensor = AlignPoints(source, target).target_from_source;
  result.agreement =
      CompareWithView(view, segmentation, structure, result.structure_from_sensor,
                      options.patch.min_confidence, SurfaceTolerance::AtRoughPose(view.errors));
  return result;
}

}  // namespace volalign

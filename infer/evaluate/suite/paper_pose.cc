#include "infer/evaluate/suite/paper_pose.h"

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "core/base/statistics.h"
#include "core/geometry/procrustes.h"

namespace volalign {

std::optional<Pose> EstimatePaperPose(const SensorView& view,
                                      const SegmentationResult& segmentation,
                                      const Structure& structure) {
  const auto classes = static_cast<std::size_t>(structure.num_classes());
  std::vector<std::array<std::vector<double>, 3>> coordinates(classes);
  view.VisitMeasured(1, [&](int u, int v) {
    const std::size_t label = segmentation.labels(u, v);
    if (label == 0 || label >= classes) return;
    const Eigen::Vector3d point = view.Point(u, v);
    for (std::size_t i = 0; i < 3; ++i)
      coordinates[label][i].push_back(point[static_cast<Eigen::Index>(i)]);
  });
  std::vector<Eigen::Vector3d> source, target;
  for (std::size_t label = 1; label < classes; ++label) {
    auto& [x, y, z] = coordinates[label];
    if (x.size() * 320 * 180 <= view.depth.size() * 200) continue;
    source.emplace_back(Quantile(std::move(x), 0.5), Quantile(std::move(y), 0.5),
                        Quantile(std::move(z), 0.5));
    target.push_back(structure.Keypoint(static_cast<int>(label), KeypointKind::kExposed));
  }
  if (source.size() < 3 || !(SecondSingularValue(target) > kMinSecondSingularValue))
    return std::nullopt;
  return AlignPoints(source, target).target_from_source;
}

}  // namespace volalign

#include "infer/initial/visibility_correction.h"

#include <Eigen/Core>

#include "core/geometry/visibility.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

struct ShownPart {
  double area = 0;                                   // m^2
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();  // area times centroid, sensor frame
};

/// By label.
std::vector<ShownPart> ShownParts(const SensorView& view, const Structure& structure,
                                  const Pose& structure_from_sensor) {
  const ExpectedView model = CastView(structure, view.rays, structure_from_sensor);
  std::vector<ShownPart> shown(static_cast<std::size_t>(structure.num_classes()));
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const int label = model.labels(u, v);
      // Where something stands in front, or nothing was measured, the patch lacks the pixel too.
      if (label == 0 || !(view.depth(u, v) > model.depth(u, v) - kFarthestOff)) continue;
      const Eigen::Vector2f& ray = view.rays.at(u, v);
      const double z = model.depth(u, v);
      const Eigen::Vector3d p(z * ray.x(), z * ray.y(), z);
      const Eigen::Vector3d normal =
          structure_from_sensor.linear().transpose() * structure.SideOfLabel(label).normal;
      const double area = view.PixelArea(u, v, z, normal);
      ShownPart& part = shown[static_cast<std::size_t>(label)];
      part.area += area;
      part.moment += area * p;
    }
  }
  return shown;
}

}  // namespace

std::vector<Eigen::Vector3d> VisibleKeypoints(const SensorView& view,
                                              const std::vector<SidePatch>& patches,
                                              const Structure& structure,
                                              const Pose& structure_from_sensor) {
  const std::vector<ShownPart> shown = ShownParts(view, structure, structure_from_sensor);
  std::vector<Eigen::Vector3d> keypoints = SideKeypoints(patches, structure);
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const ShownPart& part = shown[static_cast<std::size_t>(patches[i].label)];
    if (!(part.area > 0) || part.area < kLeastShown * patches[i].area) continue;
    keypoints[i] = structure_from_sensor * Eigen::Vector3d(part.moment / part.area);
  }
  return keypoints;
}

std::optional<Pose> CorrectForVisibility(const SensorView& view,
                                         const std::vector<SidePatch>& patches,
                                         const Structure& structure, double max_distance_m,
                                         const Pose& structure_from_sensor) {
  const std::vector<Eigen::Vector3d> keypoints =
      VisibleKeypoints(view, patches, structure, structure_from_sensor);
  const PatchSet agreeing =
      AgreeingPatches(patches, keypoints, structure, max_distance_m, structure_from_sensor);
  if (agreeing.count() < 2) return std::nullopt;
  return SolvePose(patches, agreeing, keypoints, structure);
}

}  // namespace volalign

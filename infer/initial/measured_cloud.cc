#include "infer/initial/measured_cloud.h"

#include <algorithm>

#include "core/geometry/visibility.h"

namespace volalign {

namespace {

/// Points of a sensor that are looked for among another one's, and rays of those.
constexpr double kProbeRays = 400, kCloudRays = 6000;
constexpr double kSharedDistance = 0.08;   // m, of points of one surface at poses not refined yet
constexpr double kBesideStructure = 0.15;  // m from it

std::vector<Eigen::Vector3d> PointsBeside(const SensorView& view, double rays,
                                          const Structure& structure,
                                          const std::vector<Pose>& poses) {
  const int stride = StrideForRays(view.depth.size(), rays);
  std::vector<Eigen::Vector3d> points;
  view.VisitMeasured(stride, [&](int u, int v) {
    const Eigen::Vector3d p = view.Point(u, v);
    if (std::all_of(poses.begin(), poses.end(), [&](const Pose& pose) {
          return DistanceToSurface(structure, pose * p).distance >= kBesideStructure;
        }))
      points.push_back(p);
  });
  return points;
}

}  // namespace

MeasuredCloud::MeasuredCloud(const SensorView& view, const Structure& structure,
                             const std::vector<Pose>& poses)
    : probes_(PointsBeside(view, kProbeRays, structure, poses)),
      tree_(std::make_unique<KdTree>(PointsBeside(view, kCloudRays, structure, poses))) {}

double MeasuredCloud::ShareOf(const MeasuredCloud& other, const Pose& pose,
                              const Pose& pose_of_other) const {
  if (other.probes_.empty()) return 0;
  const Pose this_from_other = pose.inverse() * pose_of_other;
  const auto shared =
      std::count_if(other.probes_.begin(), other.probes_.end(), [&](const Eigen::Vector3d& probe) {
        const KdTree::Neighbour nearest = tree_->Nearest(this_from_other * probe);
        return nearest.index >= 0 && nearest.squared_distance < kSharedDistance * kSharedDistance;
      });
  return static_cast<double>(shared) / static_cast<double>(other.probes_.size());
}

}  // namespace volalign

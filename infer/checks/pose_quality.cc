#include "infer/checks/pose_quality.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/geometry/visibility.h"
#include "infer/initial/agreement.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

constexpr double kConfirmedShare = 0.5;  // of a patch's pixels, on their side
constexpr double kSurfaceStep = 0.01;    // m, of the surface's samples

}  // namespace

SurfaceFit FitToSurface(const SensorView& view, const LabelImage& labels,
                        const Structure& structure, const Pose& structure_from_sensor) {
  const SurfaceTolerance tolerance = SurfaceTolerance::AtPose(view.errors);
  SurfaceFit fit;
  double squares = 0;
  int near = 0, inliers = 0;
  view.VisitMeasured(1, [&](int u, int v) {
    if (labels(u, v) == 0) return;
    ++fit.points;
    const double distance =
        DistanceToSurface(structure, structure_from_sensor * view.Point(u, v)).distance;
    if (distance < kFarthestOff) {
      squares += distance * distance;
      ++near;
    }
    if (distance <= tolerance(view.depth(u, v))) ++inliers;
  });
  if (near > 0) fit.rms_to_structure_m = std::sqrt(squares / near);
  if (fit.points > 0) fit.inlier_share = static_cast<double>(inliers) / fit.points;
  return fit;
}

std::vector<int> ConfirmedLabels(const SensorView& view, const std::vector<SidePatch>& patches,
                                 const Structure& structure, const Pose& structure_from_sensor) {
  const SurfaceTolerance tolerance = SurfaceTolerance::AtPose(view.errors);
  std::set<int> labels;
  for (const SidePatch& patch : patches) {
    const Side& side = structure.SideOfLabel(patch.label);
    std::size_t on_side = 0;
    for (const int pixel : patch.pixels) {
      const int u = pixel % view.width(), v = pixel / view.width();
      const Eigen::Vector3d p = structure_from_sensor * view.Point(u, v);
      if ((side.ClosestPoint(p) - p).norm() <= tolerance(view.depth(u, v))) ++on_side;
    }
    if (static_cast<double>(on_side) >= kConfirmedShare * static_cast<double>(patch.pixels.size()))
      labels.insert(patch.label);
  }
  return std::vector<int>(labels.begin(), labels.end());
}

PoseQuality MeasureQuality(const SensorView& view, const SegmentationResult& segmentation,
                           const std::vector<SidePatch>& patches, const Structure& structure,
                           const Pose& structure_from_sensor) {
  const Agreement agreement = CompareWithView(view, segmentation, structure, structure_from_sensor,
                                              SurfaceTolerance::AtPose(view.errors));
  PoseQuality quality{FitToSurface(view, segmentation.labels, structure, structure_from_sensor),
                      {},
                      agreement.miou,
                      agreement.score(),
                      agreement.explained_share()};
  for (const int label : ConfirmedLabels(view, patches, structure, structure_from_sensor))
    quality.sides.push_back(structure.SideOfLabel(label).name);
  return quality;
}

std::vector<Eigen::Vector3d> LabelledPoints(const SensorView& view, const LabelImage& labels,
                                            const Pose& structure_from_sensor) {
  std::vector<Eigen::Vector3d> points;
  view.VisitMeasured(1, [&](int u, int v) {
    if (labels(u, v) > 0) points.push_back(structure_from_sensor * view.Point(u, v));
  });
  return points;
}

std::optional<SetDistances> CompareWithSurface(const std::vector<Eigen::Vector3d>& points,
                                               const Structure& structure, int threads) {
  std::vector<Eigen::Vector3d> near;
  double squares = 0;
  for (const Eigen::Vector3d& p : points) {
    const double distance = DistanceToSurface(structure, p).distance;
    if (distance >= kFarthestOff) continue;
    near.push_back(p);
    squares += distance * distance;
  }
  if (near.empty()) return std::nullopt;
  const double d1 = std::sqrt(squares / static_cast<double>(near.size()));
  return SetDistances{
      d1, std::max(d1, RmsDistance(SampleExposedSurface(structure, kSurfaceStep), near, threads))};
}

}  // namespace volalign

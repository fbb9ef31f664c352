#include "infer/evaluate/suite/metrics.h"

#include <cmath>
#include <cstddef>
#include <map>

#include "core/visibility.h"

namespace volalign {

namespace {

/// Mean points, sensor frame, of the pixels with depth of each label.
struct MeanPoints {
  std::vector<Eigen::Vector3d> mean;
  std::vector<int> pixels;
};
MeanPoints MeanPointsOf(const SensorView& view, const LabelImage& labels, int num_classes) {
  const auto classes = static_cast<std::size_t>(num_classes);
  MeanPoints means{std::vector<Eigen::Vector3d>(classes, Eigen::Vector3d::Zero()),
                   std::vector<int>(classes, 0)};
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      if (!(view.depth(u, v) > 0)) continue;
      means.mean[labels(u, v)] += view.Point(u, v);
      ++means.pixels[labels(u, v)];
    }
  }
  for (std::size_t k = 0; k < classes; ++k) {
    if (means.pixels[k] > 0) means.mean[k] /= means.pixels[k];
  }
  return means;
}

/// The mean point, structure frame, of the pixels of each label of a rendered view.
MeanPoints MeanPointsOf(const StructureView& model, const RayTable& rays, const Pose& pose,
                        int num_classes) {
  const auto classes = static_cast<std::size_t>(num_classes);
  MeanPoints means{std::vector<Eigen::Vector3d>(classes, Eigen::Vector3d::Zero()),
                   std::vector<int>(classes, 0)};
  for (int v = 0; v < model.labels.height(); ++v) {
    for (int u = 0; u < model.labels.width(); ++u) {
      const std::size_t label = model.labels(u, v);
      const double z = model.depth(u, v);
      means.mean[label] += pose * Eigen::Vector3d(z * rays.at(u, v).x(), z * rays.at(u, v).y(), z);
      ++means.pixels[label];
    }
  }
  for (std::size_t k = 0; k < classes; ++k) {
    if (means.pixels[k] > 0) means.mean[k] /= means.pixels[k];
  }
  return means;
}

}  // namespace

PoseScore ScorePose(const SensorView& view, const LabelImage& labels, const Structure& structure,
                    const Pose& structure_from_sensor, int min_pixels) {
  const StructureView model = CastView(structure, view.rays, structure_from_sensor);
  PoseScore score;
  score.miou = MeanIou(labels, model.labels, view.depth, {structure.num_classes(), false});
  score.miou_authors = MeanIou(labels, model.labels, view.depth, {structure.num_classes(), true});
  score.miou_authors_all =
      MeanIou(labels, model.labels, DepthImage(), {structure.num_classes(), true});
  const MeanPoints seen = MeanPointsOf(view, labels, structure.num_classes());
  const MeanPoints shown =
      MeanPointsOf(model, view.rays, structure_from_sensor, structure.num_classes());
  double to_centre = 0, to_visible = 0;
  int visible = 0;
  for (int label = 1; label < structure.num_classes(); ++label) {
    const auto k = static_cast<std::size_t>(label);
    if (seen.pixels[k] < min_pixels) continue;
    const Eigen::Vector3d at = structure_from_sensor * seen.mean[k];
    ++score.sides;
    to_centre += (at - structure.SideOfLabel(label).centre).squaredNorm();
    if (shown.pixels[k] == 0) continue;
    ++visible;
    to_visible += (at - shown.mean[k]).squaredNorm();
  }
  if (score.sides > 0) score.rmse_m = std::sqrt(to_centre / score.sides);
  if (visible > 0) score.rmse_visible_m = std::sqrt(to_visible / visible);
  return score;
}

SurfaceComparison::SurfaceComparison(const Structure& structure, double spacing)
    : surface_(SampleExposedSurface(structure, spacing)) {}

std::optional<SetDistances> SurfaceComparison::operator()(
    const std::vector<Eigen::Vector3d>& points) const {
  if (points.empty()) return std::nullopt;
  return CompareSets(points, surface_);
}

ColumnStatistics Column(const std::vector<double>& values, const std::vector<int>& groups) {
  const Summary all = Summarise(values);
  ColumnStatistics column;
  column.count = static_cast<int>(values.size());
  column.mean = all.mean;
  column.std = all.std;
  column.rsd = all.rsd;
  std::map<int, std::vector<double>> by_group;
  for (std::size_t i = 0; i < values.size(); ++i) by_group[groups.at(i)].push_back(values[i]);
  for (const auto& [group, members] : by_group) {
    column.rsd_within += Summarise(members).rsd / static_cast<double>(by_group.size());
  }
  return column;
}

double DistanceToBest(double mean, double best) { return best == 0 ? 0 : mean / best - 1; }

}  // namespace volalign

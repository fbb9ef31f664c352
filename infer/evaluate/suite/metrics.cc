#include "infer/evaluate/suite/metrics.h"

#include <cmath>
#include <cstddef>
#include <map>

#include "core/geometry/visibility.h"

namespace volalign {

namespace {

/// Mean points of the pixels of each label that have a point.
struct MeanPoints {
  std::vector<Eigen::Vector3d> mean;
  std::vector<int> pixels;
};
template <class PointAt>
MeanPoints MeanPointsOf(const LabelImage& labels, int num_classes, const PointAt& point_at) {
  const auto classes = static_cast<std::size_t>(num_classes);
  MeanPoints means{std::vector<Eigen::Vector3d>(classes, Eigen::Vector3d::Zero()),
                   std::vector<int>(classes, 0)};
  for (int v = 0; v < labels.height(); ++v) {
    for (int u = 0; u < labels.width(); ++u) {
      const std::optional<Eigen::Vector3d> point = point_at(u, v);
      if (!point) continue;
      means.mean[labels(u, v)] += *point;
      ++means.pixels[labels(u, v)];
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
  const ExpectedView model = CastView(structure, view.rays, structure_from_sensor);
  PoseScore score;
  score.miou = MeanIou(labels, model.labels, view.depth, {structure.num_classes(), false});
  score.miou_authors = MeanIou(labels, model.labels, view.depth, {structure.num_classes(), true});
  score.miou_authors_all =
      MeanIou(labels, model.labels, DepthImage(), {structure.num_classes(), true});
  using Point = std::optional<Eigen::Vector3d>;
  const auto seen_at = [&](int u, int v) {  // sensor frame
    return view.depth(u, v) > 0 ? Point(view.Point(u, v)) : std::nullopt;
  };
  const auto shown_at = [&](int u, int v) {  // structure frame
    const double z = model.depth(u, v);
    const Eigen::Vector2f& ray = view.rays.at(u, v);
    return Point(structure_from_sensor * Eigen::Vector3d(z * ray.x(), z * ray.y(), z));
  };
  const MeanPoints seen = MeanPointsOf(labels, structure.num_classes(), seen_at);
  const MeanPoints shown = MeanPointsOf(model.labels, structure.num_classes(), shown_at);
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

ColumnStatistics Column(const std::vector<double>& values, const std::vector<int>& groups) {
  const Summary all = Summarise(values);
  ColumnStatistics column;
  column.count = static_cast<int>(values.size());
  column.mean = all.mean;
  column.std = all.std;
  column.rsd = all.rsd;
  std::map<int, std::vector<double>> by_group;
  for (std::size_t i = 0; i < values.size(); ++i) by_group[groups.at(i)].push_back(values[i]);
  std::vector<double> within;
  for (const auto& [group, members] : by_group) {
    if (members.size() > 1) within.push_back(Summarise(members).rsd);
  }
  if (!within.empty()) column.rsd_within = Summarise(within).mean;
  return column;
}

}  // namespace volalign

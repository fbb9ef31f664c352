#include "infer/report/panels.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "core/geometry/visibility.h"
#include "core/plot/picture.h"
#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

constexpr int kWidestFrame = 480;  // pixels; larger ones are thinned out

/// Range of depths to colour: where the middle 96 % of the pixels lie.
std::pair<double, double> DepthRange(const DepthImage& depth) {
  std::vector<float> values;
  std::copy_if(depth.begin(), depth.end(), std::back_inserter(values),
               [](float z) { return z > 0; });
  if (values.empty()) return {0.5, 5.0};
  const auto at = [&](std::size_t i) {
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(i), values.end());
    return static_cast<double>(values[i]);
  };
  const std::size_t last = values.size() - 1;
  const double low = at(last / 50), high = at(last - last / 50);
  return {low, std::max(high, low + 0.1)};
}

RgbImage ColourResiduals(const DepthImage& depth, const Image<float>& residuals) {
  const Image<float> shade = ShadeDepth(depth);
  RgbImage picture(depth.width(), depth.height());
  for (std::size_t i = 0; i < picture.size(); ++i) {
    if (!(depth[i] > 0)) continue;
    picture[i] = std::isnan(residuals[i]) ? SurroundingsColour(depth[i], 0.7 * shade[i])
                                          : SignedColour(residuals[i] / kResidualScale);
  }
  return picture;
}

void AddLabels(const LabelImage& labels, std::set<int>* shown) {
  std::vector<char> found(256, 0);
  for (const std::uint8_t label : labels) found[label] = 1;
  for (int label = 1; label < 256; ++label) {
    if (found[static_cast<std::size_t>(label)]) shown->insert(label);
  }
}

}  // namespace

Image<float> SideResiduals(const FrameResult& sensor, const Structure& structure) {
  Image<float> residuals(sensor.view.width(), sensor.view.height(),
                         std::numeric_limits<float>::quiet_NaN());
  if (!sensor.structure_from_sensor) return residuals;
  const Pose& pose = *sensor.structure_from_sensor;
  for (int v = 0; v < residuals.height(); ++v) {
    for (int u = 0; u < residuals.width(); ++u) {
      const int label = sensor.segmentation.labels(u, v);
      const double measured = sensor.view.depth(u, v);
      if (label == 0 || label >= structure.num_classes() || !(measured > 0)) continue;
      const Eigen::Vector2f& ray = sensor.view.rays.at(u, v);
      const double z = measured * sensor.depth_gain + sensor.depth_offset_m;
      const Eigen::Vector3d p = pose * Eigen::Vector3d(z * ray.x(), z * ray.y(), z);
      const Side& side = structure.SideOfLabel(label);
      residuals(u, v) = static_cast<float>(side.normal.dot(p - side.centre));
    }
  }
  return residuals;
}

FramePanels MakePanels(const FrameResult& sensor, const Structure& structure, int turns) {
  const int widest = std::max(sensor.view.width(), sensor.view.height());
  const int stride = (widest + kWidestFrame - 1) / kWidestFrame;
  const auto thinned = [&](const auto& image) {
    return stride > 1 ? DecimateImage(image, stride) : image;
  };
  const DepthImage depth = thinned(sensor.view.depth);
  const LabelImage labels = thinned(sensor.segmentation.labels);
  FramePanels panels;
  std::tie(panels.near_m, panels.far_m) = DepthRange(depth);
  panels.depth = Turn(ColourDepth(depth, panels.near_m, panels.far_m), turns);
  panels.labels = Turn(OverlayLabels(depth, labels), turns);
  std::set<int> shown;
  AddLabels(labels, &shown);
  if (sensor.structure_from_sensor) {
    const LabelImage model =
        thinned(CastView(structure, sensor.view.rays, *sensor.structure_from_sensor).labels);
    panels.model = Turn(OverlayLabels(depth, model), turns);
    panels.residual =
        Turn(ColourResiduals(depth, thinned(SideResiduals(sensor, structure))), turns);
    AddLabels(model, &shown);
  }
  panels.shown_labels.assign(shown.begin(), shown.end());
  return panels;
}

std::vector<int> UprightTurnsOf(const std::vector<FrameResult>& sensors) {
  std::map<int, int> mounted;
  for (const FrameResult& sensor : sensors) {
    if (sensor.structure_from_sensor) ++mounted[UprightTurns(*sensor.structure_from_sensor)];
  }
  int usual = 0, most = 0;
  for (const auto& [turns, count] : mounted) {
    if (count <= most) continue;
    usual = turns;
    most = count;
  }
  std::vector<int> turns;
  turns.reserve(sensors.size());
  for (const FrameResult& sensor : sensors) {
    turns.push_back(sensor.structure_from_sensor ? UprightTurns(*sensor.structure_from_sensor)
                                                 : usual);
  }
  return turns;
}

}  // namespace volalign

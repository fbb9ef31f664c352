#include "infer/io/pictures.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <map>
#include <utility>
#include <vector>

#include "core/picture.h"
#include "core/visibility.h"

namespace volalign {

namespace {

/// Range of depths to colour: where the middle 96 % of the pixels lie.
std::pair<double, double> DepthRange(const DepthImage& depth) {
  std::vector<float> values;
  std::copy_if(depth.begin(), depth.end(), std::back_inserter(values),
               [](float z) { return z > 0; });
  if (values.empty()) return {0.5, 5.0};
  std::sort(values.begin(), values.end());
  const std::size_t last = values.size() - 1;
  const double low = values[last / 50], high = values[last - last / 50];
  return {low, std::max(high, low + 0.1)};
}

}  // namespace

LabelImage ConfidenceImage(const Image<float>& confidence) {
  LabelImage image(confidence.width(), confidence.height());
  std::transform(confidence.begin(), confidence.end(), image.begin(), [](float c) {
    return static_cast<std::uint8_t>(std::lround(255 * std::clamp(c, 0.0f, 1.0f)));
  });
  return image;
}

RgbImage SensorPicture(const SensorResult& sensor, const Structure& structure, int turns) {
  const SensorView& view = sensor.view;
  const auto [near, far] = DepthRange(view.depth);
  std::vector<RgbImage> panels;
  panels.push_back(Turn(ColourDepth(view.depth, near, far), turns));
  panels.push_back(Turn(OverlayLabels(view.depth, sensor.segmentation.labels), turns));
  if (sensor.structure_from_sensor) {
    const StructureView model = CastView(structure, view.rays, *sensor.structure_from_sensor);
    panels.push_back(Turn(OverlayLabels(view.depth, model.labels), turns));
  }
  return Montage(panels, 3);
}

std::vector<int> UprightTurnsOf(const std::vector<SensorResult>& sensors) {
  std::map<int, int> mounted;
  for (const SensorResult& sensor : sensors) {
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
  for (const SensorResult& sensor : sensors) {
    turns.push_back(sensor.structure_from_sensor ? UprightTurns(*sensor.structure_from_sensor)
                                                 : usual);
  }
  return turns;
}

}  // namespace volalign

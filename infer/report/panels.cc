#include "infer/report/panels.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "core/base/noise_fields.h"
#include "core/base/statistics.h"
#include "core/geometry/visibility.h"
#include "core/plot/picture.h"
#include "core/plot/picture_text.h"
#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

constexpr int kWidestFrame = 480;  // pixels; larger ones are thinned out
constexpr Rgb kEdge{255, 40, 90};  // DepthColour does not have it
constexpr double kOnSide = 0.1;    // m, limit of the RMS to the structure, too

/// Range of depths to colour, of the middle 96 % of the pixels.
std::pair<double, double> DepthRange(const DepthImage& depth) {
  std::vector<float> values;
  std::copy_if(depth.begin(), depth.end(), std::back_inserter(values),
               [](float z) { return z > 0; });
  if (values.empty()) return {0.5, 5.0};
  const double low = Quantile(values, 0.02), high = Quantile(values, 0.98);
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

int StrideOf(const FrameResult& sensor) {
  const int widest = std::max(sensor.view.width(), sensor.view.height());
  return (widest + kWidestFrame - 1) / kWidestFrame;
}

template <class Pixels>
Pixels EvenSubset(const Pixels& image, int stride) {
  return stride > 1 ? DecimateImage(image, stride) : image;
}

/// Draws the pixels of the structure at which another side, or none, begins.
void DrawEdges(const ExpectedView& view, int stride, RgbImage* picture) {
  const DepthImage depth = EvenSubset(view.depth, stride);
  const LabelImage labels = EvenSubset(view.labels, stride);
  ForEachNeighbourPair(depth.width(), depth.height(),
                       [&](int u, int v, int p, int q, std::uint64_t /*pair*/) {
                         const bool here = depth(u, v) > 0, there = depth(p, q) > 0;
                         if (here == there && labels(u, v) == labels(p, q)) return;
                         (here ? (*picture)(u, v) : (*picture)(p, q)) = kEdge;
                       });
}

std::vector<SideFit> SideFits(const LabelImage& labels, const Image<float>& residuals) {
  std::map<int, SideFit> fits;
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    const double residual = residuals[i];
    if (!(std::abs(residual) < kOnSide)) continue;
    SideFit& fit = fits[labels[i]];
    ++fit.points;
    fit.mean_m += residual;
    fit.rms_m += residual * residual;
  }
  std::vector<SideFit> list;
  for (const auto& [label, sum] : fits)
    list.push_back({label, sum.points, sum.mean_m / sum.points, std::sqrt(sum.rms_m / sum.points)});
  return list;
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

RgbImage EdgesPanel(const FrameResult& sensor, const Structure& structure,
                    const Pose& structure_from_sensor, int turns) {
  const int stride = StrideOf(sensor);
  const DepthImage depth = EvenSubset(sensor.view.depth, stride);
  const auto [near_m, far_m] = DepthRange(depth);
  RgbImage picture = ColourDepth(depth, near_m, far_m);
  DrawEdges(CastView(structure, sensor.view.rays, structure_from_sensor), stride, &picture);
  return Turn(picture, turns);
}

FramePanels MakePanels(const FrameResult& sensor, const Structure& structure, int turns) {
  const int stride = StrideOf(sensor);
  const DepthImage depth = EvenSubset(sensor.view.depth, stride);
  const LabelImage labels = EvenSubset(sensor.segmentation.labels, stride);
  FramePanels panels;
  std::tie(panels.near_m, panels.far_m) = DepthRange(depth);
  panels.depth = Turn(ColourDepth(depth, panels.near_m, panels.far_m), turns);
  panels.labels = Turn(OverlayLabels(depth, labels), turns);
  std::set<int> shown;
  AddLabels(labels, &shown);
  if (const std::optional<Pose>& pose =
          sensor.structure_from_sensor ? sensor.structure_from_sensor : sensor.best_guess)
    panels.edges = EdgesPanel(sensor, structure, *pose, turns);
  if (sensor.structure_from_sensor) {
    const Image<float> residuals = SideResiduals(sensor, structure);
    panels.residual = Turn(ColourResiduals(depth, EvenSubset(residuals, stride)), turns);
    panels.sides = SideFits(sensor.segmentation.labels, residuals);
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

namespace {

constexpr int kMargin = 6;                     // pixels, between everything
constexpr int kLine = kTextHeight + 3;         // from one line of text to the next
constexpr int kSwatch = 10;                    // side of a legend's square
constexpr int kScaleBlock = kScaleHeight + 6;  // a scale and the space below it
constexpr int kGap = 2;                        // between panels, as Shelves has it

struct LegendEntry {
  Rgb colour;
  std::string text;
};

std::vector<LegendEntry> LabelLegend(const Structure& structure, const std::vector<int>& labels) {
  std::vector<LegendEntry> entries = {{Rgb{0, 0, 0}, "no measurement"},
                                      {SurroundingsColour(1.5, 0.78), "surroundings"}};
  for (const int label : labels) {
    if (label < structure.num_classes())
      entries.push_back({LabelColour(label), structure.SideOfLabel(label).name});
  }
  return entries;
}

/// Squares and names in columns below a picture.
RgbImage WithLegend(const RgbImage& picture, const std::vector<LegendEntry>& entries) {
  int longest = 0;
  for (const LegendEntry& entry : entries) longest = std::max(longest, CountCharacters(entry.text));
  const int column = kSwatch + 4 + kTextWidth * longest + 2 * kMargin;
  const int columns = std::max(1, (picture.width() - kMargin) / column);
  const int count = static_cast<int>(entries.size());
  const int rows = (count + columns - 1) / columns;
  RgbImage sheet(picture.width(), picture.height() + rows * kLine + kMargin, kPaper);
  for (int v = 0; v < picture.height(); ++v) {
    for (int u = 0; u < picture.width(); ++u) sheet(u, v) = picture(u, v);
  }
  for (int i = 0; i < count; ++i) {
    const LegendEntry& entry = entries[static_cast<std::size_t>(i)];
    const int left = kMargin + i / rows * column, top = picture.height() + i % rows * kLine;
    FillRectangle(&sheet, left, top + 1, kSwatch, kSwatch, kFaint);
    FillRectangle(&sheet, left + 1, top + 2, kSwatch - 2, kSwatch - 2, entry.colour);
    DrawText(&sheet, left + kSwatch + 4, top, entry.text, kInk);
  }
  return sheet;
}

std::string Title(const SensorOutcome& sensor) {
  std::string title = fmt::format("{}: {}", sensor.name, ToString(sensor.status));
  if (sensor.code != SensorCode::kNone) title += fmt::format(" ({})", ToString(sensor.code));
  if (sensor.structure_from_sensor && sensor.covariance.allFinite()) {
    title +=
        fmt::format(", {:.1f} mm RMS to the structure, sigma {:.1f} mm and {:.2f} deg",
                    1000 * sensor.rms_to_structure_m, 1000 * sensor.sigma_position_m().maxCoeff(),
                    sensor.sigma_rotation_deg().maxCoeff());
  }
  return title;
}

}  // namespace

LabelImage ConfidenceImage(const Image<float>& confidence) {
  LabelImage image(confidence.width(), confidence.height());
  std::transform(confidence.begin(), confidence.end(), image.begin(), [](float c) {
    return static_cast<std::uint8_t>(std::lround(255 * std::clamp(c, 0.0f, 1.0f)));
  });
  return image;
}

RgbImage SensorPicture(const SensorOutcome& sensor, const FramePanels& panels,
                       const Structure& structure, bool caption_labels) {
  const std::vector<std::pair<const RgbImage*, std::string>> all = {
      {&panels.depth, "measured depth, m"},
      {&panels.labels, "labels found"},
      {&panels.edges, "structure's edges at the pose"},
      {&panels.residual, "residual, mm"}};
  std::vector<RgbImage> images;
  for (const auto& [image, caption] : all) {
    if (!image->empty()) images.push_back(*image);
  }
  const RgbImage row = Shelves(images, static_cast<int>(images.size()));
  const int width = panels.depth.width(), height = panels.depth.height();
  const int top = kMargin + 2 * kLine;
  RgbImage picture(row.width() + 2 * kMargin, top + height + 4 + kScaleBlock, kPaper);
  DrawText(&picture, kMargin, kMargin - 2,
           Ellipsized(Title(sensor), (picture.width() - 2 * kMargin) / kTextWidth), kInk);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < row.width(); ++u) picture(kMargin + u, top + v) = row(u, v);
  }
  for (std::size_t i = 0; i < images.size(); ++i) {
    const int left = kMargin + static_cast<int>(i) * (width + kGap);
    DrawText(&picture, left, top - kLine, Ellipsized(all[i].second, width / kTextWidth), kFaint);
    const int below = top + height + 4;
    if (i == 0) {
      DrawScale(&picture, left, below, width, DepthColour,
                {fmt::format("{:.2f}", panels.near_m),
                 fmt::format("{:.2f}", (panels.near_m + panels.far_m) / 2),
                 fmt::format("{:.2f}", panels.far_m)});
    }
    if (i == 3) {
      DrawScale(&picture, left, below, width, [](double t) { return SignedColour(2 * t - 1); },
                {fmt::format("{:.0f}: too far", -1000 * kResidualScale), "0",
                 fmt::format("too near: {:.0f}", 1000 * kResidualScale)});
    }
  }
  return caption_labels ? WithLegend(picture, LabelLegend(structure, panels.shown_labels))
                        : picture;
}

RgbImage OverviewPicture(const std::vector<RgbImage>& pictures, const Structure& structure) {
  const int widest = pictures.size() > 3 ? 2 : 1;
  std::vector<int> labels;
  for (int label = 1; label < structure.num_classes(); ++label) labels.push_back(label);
  return WithLegend(Shelves(pictures, widest), LabelLegend(structure, labels));
}

}  // namespace volalign

#include "infer/report/pictures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

#include "core/plot/picture.h"
#include "core/plot/picture_text.h"

namespace volalign {

namespace {

constexpr int kMargin = 6;                     // pixels, between everything
constexpr int kLine = kTextHeight + 3;         // from one line of text to the next
constexpr int kSwatch = 10;                    // side of a legend's square
constexpr int kScaleBlock = kScaleHeight + 6;  // a scale and the space below it
constexpr int kGap = 2;                        // between panels, as Montage has it

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
  const RgbImage row = Montage(images, static_cast<int>(images.size()));
  const int width = panels.depth.width(), height = panels.depth.height();
  const int top = kMargin + 2 * kLine;
  RgbImage picture(row.width() + 2 * kMargin, top + height + 4 + kScaleBlock, kPaper);
  DrawText(&picture, kMargin, kMargin - 2,
           Shortened(Title(sensor), (picture.width() - 2 * kMargin) / kTextWidth), kInk);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < row.width(); ++u) picture(kMargin + u, top + v) = row(u, v);
  }
  for (std::size_t i = 0; i < images.size(); ++i) {
    const int left = kMargin + static_cast<int>(i) * (width + kGap);
    DrawText(&picture, left, top - kLine, Shortened(all[i].second, width / kTextWidth), kFaint);
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

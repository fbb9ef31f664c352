#include "core/picture.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"

namespace volalign {

namespace {

/// Turbo as a polynomial (A. Mikhailov, "Turbo, an improved rainbow colormap", 2019; polynomial by
/// R. Du), t in [0, 1].
Rgb Turbo(double t) {
  const double t2 = t * t, t3 = t2 * t, t4 = t2 * t2, t5 = t4 * t;
  const double r = 0.13572138 + 4.61539260 * t - 42.66032258 * t2 + 132.13108234 * t3 -
                   152.94239396 * t4 + 59.28637943 * t5;
  const double g = 0.09140261 + 2.19418839 * t + 4.84296658 * t2 - 14.18503333 * t3 +
                   4.27729857 * t4 + 2.82956604 * t5;
  const double b = 0.10667330 + 12.64194608 * t - 60.58204836 * t2 + 110.36276771 * t3 -
                   89.90310912 * t4 + 27.34824973 * t5;
  const auto byte = [](double x) {
    return static_cast<std::uint8_t>(std::lround(255 * std::clamp(x, 0.0, 1.0)));
  };
  return {byte(r), byte(g), byte(b)};
}

Rgb FromHsv(double hue_deg, double saturation, double value) {
  const auto channel = [&](double n) {
    const double k = std::fmod(n + hue_deg / 60, 6.0);
    const double x = value - value * saturation * std::max(0.0, std::min({k, 4 - k, 1.0}));
    return static_cast<std::uint8_t>(std::lround(255 * x));
  };
  return {channel(5), channel(3), channel(1)};
}

}  // namespace

Rgb LabelColour(int label) {
  if (label <= 0) return {0, 0, 0};
  // Five labels a box: the golden angle tells boxes apart, saturation and value their sides.
  const int group = (label - 1) / 5, member = (label - 1) % 5;
  static constexpr double kSaturation[] = {0.95, 0.55, 0.30, 0.85, 0.60};
  static constexpr double kValue[] = {1.0, 0.95, 1.0, 0.62, 0.72};
  static constexpr double kHueShift[] = {0, 18, 6, -14, 30};
  const double hue = std::fmod(group * 137.508 + 20 + kHueShift[member] + 360, 360.0);
  return FromHsv(hue, kSaturation[member], kValue[member]);
}

RgbImage ColourLabels(const LabelImage& labels) {
  RgbImage picture(labels.width(), labels.height());
  for (std::size_t i = 0; i < labels.size(); ++i) picture[i] = LabelColour(labels[i]);
  return picture;
}

RgbImage ColourDepth(const DepthImage& depth, double near_m, double far_m) {
  RgbImage picture(depth.width(), depth.height());
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (!(depth[i] > 0)) continue;
    const double t = std::clamp((depth[i] - near_m) / (far_m - near_m), 0.0, 1.0);
    picture[i] = Turbo(0.95 - 0.9 * t);
  }
  return picture;
}

RgbImage OverlayLabels(const DepthImage& depth, const LabelImage& labels) {
  if (labels.width() != depth.width() || labels.height() != depth.height()) {
    throw Error("OverlayLabels: the depth and the label map have different sizes");
  }
  RgbImage picture(depth.width(), depth.height());
  for (int v = 0; v < depth.height(); ++v) {
    for (int u = 0; u < depth.width(); ++u) {
      const float z = depth(u, v);
      if (!(z > 0)) continue;
      // Shade by the depth's slope, so that faces stand out under flat label colours.
      const float right = u + 1 < depth.width() ? depth(u + 1, v) : 0;
      const float below = v + 1 < depth.height() ? depth(u, v + 1) : 0;
      double slope = 0;
      if (right > 0 && below > 0) slope = std::clamp(40.0 * (right - z + below - z) / z, -1.0, 1.0);
      const double shade = 0.78 - 0.22 * slope;
      const Rgb colour = labels(u, v) == 0 ? Rgb{110, 110, 110} : LabelColour(labels(u, v));
      const double fade = labels(u, v) == 0 ? std::clamp(1.2 - z / 7.0, 0.25, 1.0) : 1.0;
      picture(u, v) = {static_cast<std::uint8_t>(colour.r * shade * fade),
                       static_cast<std::uint8_t>(colour.g * shade * fade),
                       static_cast<std::uint8_t>(colour.b * shade * fade)};
    }
  }
  return picture;
}

RgbImage Montage(const std::vector<RgbImage>& pictures, int columns) {
  constexpr int kGap = 2;
  int cell_width = 0, cell_height = 0;
  for (const RgbImage& picture : pictures) {
    cell_width = std::max(cell_width, picture.width());
    cell_height = std::max(cell_height, picture.height());
  }
  const int count = static_cast<int>(pictures.size());
  columns = std::clamp(columns, 1, std::max(1, count));
  const int rows = (count + columns - 1) / columns;
  RgbImage sheet(columns * (cell_width + kGap) - kGap,
                 std::max(1, rows * (cell_height + kGap) - kGap), Rgb{40, 40, 48});
  for (int i = 0; i < count; ++i) {
    const RgbImage& picture = pictures[static_cast<std::size_t>(i)];
    const int left = (i % columns) * (cell_width + kGap),
              top = (i / columns) * (cell_height + kGap);
    for (int v = 0; v < picture.height(); ++v) {
      for (int u = 0; u < picture.width(); ++u) sheet(left + u, top + v) = picture(u, v);
    }
  }
  return sheet;
}

}  // namespace volalign

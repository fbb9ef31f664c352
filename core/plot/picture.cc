#include "core/plot/picture.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/error.h"

namespace volalign {

namespace {

struct Stop {
  double at;
  Rgb colour;
};

/// Interpolates in steps that the eye cannot distinguish and that leave a picture few colours.
template <std::size_t N>
Rgb Between(const Stop (&stops)[N], double t) {
  constexpr double kSteps = 160;
  t = std::round(std::clamp(t, 0.0, 1.0) * kSteps) / kSteps;
  std::size_t i = 1;
  while (i + 1 < N && t > stops[i].at) ++i;
  const Stop &low = stops[i - 1], &high = stops[i];
  const double share = (t - low.at) / (high.at - low.at);
  const auto mix = [&](std::uint8_t a, std::uint8_t b) {
    return static_cast<std::uint8_t>(std::lround(a + share * (b - a)));
  };
  return {mix(low.colour.r, high.colour.r), mix(low.colour.g, high.colour.g),
          mix(low.colour.b, high.colour.b)};
}

/// Viridis (S. van der Walt and N. Smith, CC0) at ninths.
constexpr Stop kViridis[] = {{0.0, {68, 1, 84}},        {1 / 9.0, {72, 40, 120}},
                             {2 / 9.0, {62, 74, 137}},  {3 / 9.0, {49, 104, 142}},
                             {4 / 9.0, {38, 130, 142}}, {5 / 9.0, {31, 158, 137}},
                             {6 / 9.0, {53, 183, 121}}, {7 / 9.0, {109, 205, 89}},
                             {8 / 9.0, {180, 222, 44}}, {1.0, {253, 231, 37}}};

/// Blue over a light grey to orange, which no common colour blindness confuses (after PuOr of C.
/// Brewer's ColorBrewer, with blue for purple).
constexpr Stop kDiverging[] = {{0.0, {5, 60, 145}},
                               {0.25, {84, 148, 216}},
                               {0.5, {236, 236, 232}},
                               {0.75, {241, 150, 62}},
                               {1.0, {150, 60, 5}}};

Rgb FromHsv(double hue_deg, double saturation, double value) {
  const auto channel = [&](double n) {
    const double k = std::fmod(n + hue_deg / 60, 6.0);
    const double x = value - value * saturation * std::max(0.0, std::min({k, 4 - k, 1.0}));
    return static_cast<std::uint8_t>(std::lround(255 * x));
  };
  return {channel(5), channel(3), channel(1)};
}

constexpr int kGap = 2;  // between pictures on a sheet

}  // namespace

Rgb LabelColour(int label) {
  if (label <= 0) return {0, 0, 0};
  // Five labels per box: the golden angle separates boxes, saturation and value their sides.
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

Rgb DepthColour(double t) { return Between(kViridis, 1 - 0.95 * std::clamp(t, 0.0, 1.0)); }

Rgb SignedColour(double t) { return Between(kDiverging, (1 + t) / 2); }

RgbImage ColourDepth(const DepthImage& depth, double near_m, double far_m) {
  RgbImage picture(depth.width(), depth.height());
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (!(depth[i] > 0)) continue;
    picture[i] = DepthColour((depth[i] - near_m) / (far_m - near_m));
  }
  return picture;
}

Image<float> ShadeDepth(const DepthImage& depth) {
  constexpr double kSteps = 7;
  Image<float> shade(depth.width(), depth.height());
  for (int v = 0; v < depth.height(); ++v) {
    for (int u = 0; u < depth.width(); ++u) {
      const float z = depth(u, v);
      if (!(z > 0)) continue;
      const float right = u + 1 < depth.width() ? depth(u + 1, v) : 0;
      const float below = v + 1 < depth.height() ? depth(u, v + 1) : 0;
      double slope = 0;
      if (right > 0 && below > 0) slope = std::clamp(40.0 * (right - z + below - z) / z, -1.0, 1.0);
      shade(u, v) = static_cast<float>(0.78 - 0.22 * std::round(kSteps * slope) / kSteps);
    }
  }
  return shade;
}

Rgb SurroundingsColour(double z, double shade) {
  // Even numbers: with the labels' shades these are few enough for a palette.
  const double fade = std::clamp(1.2 - z / 7.0, 0.25, 1.0);
  const auto grey = static_cast<std::uint8_t>(2 * std::lround(55 * shade * fade));
  return {grey, grey, grey};
}

RgbImage OverlayLabels(const DepthImage& depth, const LabelImage& labels) {
  if (labels.width() != depth.width() || labels.height() != depth.height()) {
    throw Error("OverlayLabels: the depth and the label map have different sizes");
  }
  const Image<float> shades = ShadeDepth(depth);
  RgbImage picture(depth.width(), depth.height());
  for (std::size_t i = 0; i < picture.size(); ++i) {
    if (!(depth[i] > 0)) continue;
    const double shade = shades[i];
    const Rgb colour = LabelColour(labels[i]);
    picture[i] = labels[i] == 0 ? SurroundingsColour(depth[i], shade)
                                : Rgb{static_cast<std::uint8_t>(colour.r * shade),
                                      static_cast<std::uint8_t>(colour.g * shade),
                                      static_cast<std::uint8_t>(colour.b * shade)};
  }
  return picture;
}

RgbImage Shelves(const std::vector<RgbImage>& pictures, int widest) {
  int limit = 0;
  for (const RgbImage& picture : pictures)
    limit = std::max(limit, widest * (picture.width() + kGap) - kGap);
  std::vector<std::pair<int, int>> corners;  // upper left
  int left = 0, top = 0, width = 0, bottom = 0;
  for (const RgbImage& picture : pictures) {
    if (left > 0 && left + picture.width() > limit) {
      left = 0;
      top = bottom + kGap;
    }
    corners.emplace_back(left, top);
    width = std::max(width, left + picture.width());
    bottom = std::max(bottom, top + picture.height());
    left += picture.width() + kGap;
  }
  RgbImage sheet(width, std::max(1, bottom), Rgb{40, 40, 48});
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const auto& [column, row] = corners[i];
    for (int v = 0; v < pictures[i].height(); ++v) {
      for (int u = 0; u < pictures[i].width(); ++u) sheet(column + u, row + v) = pictures[i](u, v);
    }
  }
  return sheet;
}

}  // namespace volalign

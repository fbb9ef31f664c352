#include "infer/report/html_report/encode.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/base/file_util.h"
#include "core/formats/image_io.h"

namespace volalign {

namespace {

void AppendInt16(std::string* bytes, double steps) {
  const auto value = static_cast<std::int16_t>(std::lround(std::clamp(steps, -32767.0, 32767.0)));
  const auto bits = static_cast<std::uint16_t>(value);
  *bytes += static_cast<char>(bits & 0xff);
  *bytes += static_cast<char>(bits >> 8);
}

/// Takes one point of each of `most` equal stretches of the list. Its place differs from stretch to
/// stretch, so that rows and columns of pixels leave no pattern.
void TakeEvenly(const std::vector<const AlignedPoint*>& points, std::size_t most,
                std::vector<AlignedPoint>* taken) {
  const std::size_t count = std::min(most, points.size());
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t begin = i * points.size() / count, end = (i + 1) * points.size() / count;
    constexpr std::size_t kScatter = 2654435761;  // Knuth's multiplicative hash
    taken->push_back(*points[begin + (i * kScatter >> 16) % (end - begin)]);
  }
}

}  // namespace

std::string PngDataUri(const RgbImage& picture) {
  return "data:image/png;base64," + Base64(EncodePalettePng(picture));
}

std::string HexColour(Rgb colour) {
  return fmt::format("#{:02x}{:02x}{:02x}", colour.r, colour.g, colour.b);
}

EncodedCloud EncodeCloud(const std::vector<AlignedPoint>& points) {
  std::string positions, labels, residuals;
  for (const AlignedPoint& point : points) {
    for (int i = 0; i < 3; ++i) AppendInt16(&positions, point.p[i] / kPointStep);
    labels += static_cast<char>(point.label);
    const bool known = std::isfinite(point.side_residual);
    const double steps = known ? std::clamp(point.side_residual / kResidualStep, -127.0, 127.0)
                               : static_cast<double>(kNoResidual);
    residuals += static_cast<char>(static_cast<std::int8_t>(std::lround(steps)));
  }
  return {points.size(), Base64(positions), Base64(labels), Base64(residuals)};
}

std::vector<AlignedPoint> ThinCloud(const std::vector<AlignedPoint>& points, std::size_t most) {
  if (points.size() <= most) return points;
  constexpr double kLabelledShare = 0.6;
  std::vector<const AlignedPoint*> labelled, others;
  for (const AlignedPoint& point : points) (point.label > 0 ? labelled : others).push_back(&point);
  const auto share = static_cast<std::size_t>(kLabelledShare * static_cast<double>(most));
  const std::size_t of_others = std::min(others.size(), most - std::min(labelled.size(), share));
  std::vector<AlignedPoint> thinned;
  TakeEvenly(labelled, most - of_others, &thinned);
  TakeEvenly(others, of_others, &thinned);
  return thinned;
}

}  // namespace volalign

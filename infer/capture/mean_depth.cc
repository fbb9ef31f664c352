#include "infer/capture/mean_depth.h"

#include <algorithm>
#include <cmath>

#include "core/base/statistics.h"
#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

constexpr double kFinestStep = 1e-4;  // m, of depth that is stored as floats

/// What several frames say about one pixel, in their units.
struct PixelMean {
  double value = 0, sigma = 0;
};

/// `values`: not zero, in whole `steps`. `jump`: how far two values of one surface may be apart.
PixelMean MeanOf(const std::vector<float>& values, double step, double jump) {
  constexpr double kWithin = 0.68;      // share of the values, of a normal distribution's one sigma
  constexpr double kFar = 3;            // spreads, of a value that does not count
  constexpr double kLeastSpread = 0.3;  // rounding to steps has a standard deviation of 0.29
  if (values.empty()) return {};
  const double middle = Quantile(values, 0.5);
  std::vector<double> deviations;
  deviations.reserve(values.size());
  for (const float value : values) deviations.push_back(std::abs(value - middle));
  const double spread = std::max(kLeastSpread * step, NearestQuantile(deviations, kWithin));
  const double gate = std::min(std::max(step, kFar * spread), jump);
  double sum = 0, count = 0;
  for (const float value : values) {
    if (std::abs(value - middle) > gate) continue;
    sum += value;
    ++count;
  }
  return {sum / count, spread / std::sqrt(static_cast<double>(values.size()))};
}

Image<float> Scaled(const Image<float>& values, double scale) {
  Image<float> metres(values.width(), values.height());
  for (std::size_t i = 0; i < values.size(); ++i)
    metres[i] = static_cast<float>(static_cast<double>(values[i]) * scale);
  return metres;
}

}  // namespace

void SetMeanDepth(const std::vector<StoredDepth>& images, SensorFrame* frame) {
  const double scale = frame->depth_scale;
  frame->depth = Scaled(images.front().values, scale);
  if (images.size() == 1) return;
  const bool whole = std::all_of(images.begin(), images.end(),
                                 [](const StoredDepth& image) { return image.whole_numbers; });
  const double step = whole ? 1 : kFinestStep / scale;
  frame->depth_sigma = Image<float>(frame->depth.width(), frame->depth.height(), 0.0f);
  std::vector<float> values;
  for (std::size_t i = 0; i < frame->depth.size(); ++i) {
    values.clear();
    for (const StoredDepth& image : images) {
      if (image.values[i] > 0) values.push_back(image.values[i]);
    }
    const double near = values.empty() ? 0 : scale * static_cast<double>(Quantile(values, 0.5));
    const PixelMean mean = MeanOf(values, step, DepthJump(near) / scale);
    frame->depth[i] = static_cast<float>(scale * mean.value);
    frame->depth_sigma[i] = static_cast<float>(scale * mean.sigma);
  }
}

}  // namespace volalign

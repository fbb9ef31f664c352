#include "infer/capture/mean_depth.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/statistics.h"
#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

constexpr double kFinestStep = 1e-4;  // m, of depth that is stored as floats
constexpr int kFewest = 3;            // values that have a deviation

}  // namespace

void MeanDepth::Count(float value, Pixel* pixel) {
  ++pixel->count;
  if (std::abs(value - pixel->middle) > pixel->gate) return;
  pixel->sum += value;
  ++pixel->near;
}

/// `values`: not zero, in whole `steps`.
MeanDepth::Pixel MeanDepth::Begin(const std::vector<float>& values, double step) const {
  constexpr double kMiddle = 0.499;  // the median; of two middle values the lower
  constexpr double kWithin = 0.68;  // share of the values within one sigma of a normal distribution
  constexpr double kFar = 3;        // spreads, of a value that does not count
  constexpr double kLeastSpread = 0.3;  // rounding to steps has a standard deviation of 0.29
  Pixel pixel;
  if (values.empty()) return pixel;
  const double middle = Quantile(values, kMiddle);
  std::vector<double> deviations;
  deviations.reserve(values.size());
  for (const float value : values) deviations.push_back(std::abs(value - middle));
  const double spread = std::max(kLeastSpread * step, Quantile(deviations, kWithin));
  // Largest difference of two values of one surface.
  const double jump = DepthJump(scale_ * middle) / scale_;
  pixel.middle = static_cast<float>(middle);
  pixel.spread = static_cast<float>(spread);
  pixel.gate = static_cast<float>(std::min(std::max(step, kFar * spread), jump));
  return pixel;
}

void MeanDepth::BeginAll() {
  const bool whole = std::all_of(kept_.begin(), kept_.end(),
                                 [](const StoredDepth& image) { return image.whole_numbers; });
  const double step = whole ? 1 : kFinestStep / scale_;
  pixels_ = Image<Pixel>(kept_[0].values.width(), kept_[0].values.height());
  std::vector<float> values;
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    values.clear();
    for (const StoredDepth& image : kept_) {
      if (image.values[i] > 0) values.push_back(image.values[i]);
    }
    pixels_[i] = Begin(values, step);
    for (const float value : values) Count(value, &pixels_[i]);
  }
  kept_.clear();
}

void MeanDepth::Add(StoredDepth image) {
  ++images_;
  if (pixels_.empty()) {
    if (kept_.size() < kMostKept) {
      kept_.push_back(std::move(image));
      return;
    }
    BeginAll();
  }
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    const float value = image.values[i];
    if (!(value > 0)) continue;
    // Measured for the first time.
    if (pixels_[i].count == 0)
      pixels_[i] = Begin({value}, image.whole_numbers ? 1 : kFinestStep / scale_);
    Count(value, &pixels_[i]);
  }
}

void MeanDepth::Set(SensorFrame* frame) {
  const bool single = pixels_.empty() && kept_.size() == 1;
  if (single) {
    const Image<float>& values = kept_[0].values;
    frame->depth = DepthImage(values.width(), values.height());
    for (std::size_t i = 0; i < values.size(); ++i)
      frame->depth[i] = static_cast<float>(static_cast<double>(values[i]) * scale_);
    return;
  }
  if (pixels_.empty()) BeginAll();
  frame->depth = DepthImage(pixels_.width(), pixels_.height(), 0.0f);
  frame->depth_sigma = Image<float>(pixels_.width(), pixels_.height(), 0.0f);
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    const Pixel& pixel = pixels_[i];
    if (pixel.count < std::min(kFewest, images_)) continue;
    frame->depth[i] = static_cast<float>(scale_ * pixel.sum / pixel.near);
    frame->depth_sigma[i] =
        static_cast<float>(scale_ * pixel.spread / std::sqrt(static_cast<double>(pixel.count)));
  }
}

void SetMeanDepth(std::vector<StoredDepth> images, SensorFrame* frame) {
  MeanDepth mean(frame->depth_scale);
  for (StoredDepth& image : images) mean.Add(std::move(image));
  mean.Set(frame);
}

}  // namespace volalign

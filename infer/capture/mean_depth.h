#pragma once

#include <cstddef>
#include <vector>

#include "core/base/image.h"
#include "infer/formats/depth_file.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// The mean of frames of a scene without motion, which are added one after the other. A pixel
/// becomes the mean of those of its non-zero values that are near their (lower) median. No value is
/// thus invented between foreground and background. Its sigma is the standard error of that mean,
/// by the deviation from the median that 68 % of the values keep. Median and deviation are those of
/// the first kMostKept frames; only these are kept. For a pixel that they did not measure, its
/// first value is the median. A pixel has no depth if fewer than three frames measured it (two, of
/// two frames): one value says nothing about its deviation.
class MeanDepth {
 public:
  static constexpr std::size_t kMostKept = 32;

  /// `depth_scale`: metres per unit of the frames.
  explicit MeanDepth(double depth_scale) : scale_(depth_scale) {}

  /// Adds a frame; all have one size.
  void Add(StoredDepth image);
  /// Sets the frame's depth and, of several images, its depth_sigma, m. At least one image has to
  /// be added before.
  void Set(SensorFrame* frame);

 private:
  /// The frames' values of one pixel, in their units.
  struct Pixel {
    double sum = 0;  // of the values near `middle`
    float middle = 0, spread = 0, gate = 0;
    int near = 0, count = 0;  // values near it, and all
  };
  Pixel Begin(const std::vector<float>& values, double step) const;
  static void Count(float value, Pixel* pixel);
  void BeginAll();

  double scale_;
  int images_ = 0;
  std::vector<StoredDepth> kept_;
  Image<Pixel> pixels_;  // empty as long as all frames are kept
};

/// Sets the mean of `images`, by frame->depth_scale.
void SetMeanDepth(std::vector<StoredDepth> images, SensorFrame* frame);

}  // namespace volalign

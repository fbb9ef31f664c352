#pragma once

#include <cstdint>

namespace volalign::simd {

/// Rows of a feature map in channels-last order, and the arrays around it. Plain pointers, so that
/// the kernels can be compiled for several instruction sets without sharing an inline function with
/// the rest of the program.
///
/// `raw` is a convolution's output. The map is z = act(a raw + b) mask, where a and b are [C] of
/// the sample. The function act is max(., 0) or nothing. The mask is one number per pixel or
/// nothing. If `phases`, raw [h+1,w+1,2,2,C] becomes z [2h,2w,C]: pixel (2y+i, 2x+j) lies at
/// raw[y+i][x+j][i][j].
struct MapRows {
  std::int64_t width = 0, channels = 0;  ///< of z
  bool raw_bf16 = false, map_bf16 = false;
  bool phases = false, relu = true;
  const void* raw = nullptr;     ///< of the sample
  void* raw_gradient = nullptr;  ///< as raw
  void* map = nullptr;  ///< z or its gradient, of the sample; a pixel is map_stride elements wide
  std::int64_t map_stride = 0;
  const float *a = nullptr, *b = nullptr;  ///< [C] of the sample
  const float* mask = nullptr;             ///< [h',w'] of the sample, or none
  const std::int32_t *mask_row = nullptr, *mask_column = nullptr;  ///< [H], [W]: nearest pixel
  std::int64_t mask_width = 0;
  void* pooled = nullptr;          ///< max over 2x2 of z or its gradient [H/2,W/2,C], or none
  std::uint8_t* winner = nullptr;  ///< [H/2,W/2,C]: which of the four pixels was the largest
  std::int64_t pooled_height = 0, pooled_width = 0;
};

/// The pixels of a sample in the training loss: log_probs [K,plane], labels [plane] in [0, K),
/// depth [plane] and rays [2,plane]. The point of a pixel is (rx z, ry z, z); z is 0 without depth.
///
/// Sums, each added to, in this order. First, for label k > 0, sums[4k-4 .. 4k) of
/// exp(log_probs[k]) (x, y, z, 1) over the pixels with depth. Then, by label, [K] of
/// -log_probs[label], [K] the number of pixels, and [K] the number of those with depth. Last, the
/// number of labels outside of [0, K), whose pixels count nowhere else.
struct PixelSums {
  std::int64_t classes = 0, plane = 0;
  const float *log_probs = nullptr, *depth = nullptr, *rays = nullptr;
  const std::int64_t* labels = nullptr;
  static constexpr std::int64_t Count(std::int64_t classes) {
    return 4 * (classes - 1) + 3 * classes + 1;
  }
};

/// Functions over rows [begin, end) of a sample; `sums` are added to.
struct MapKernels {
  /// sum of raw - shift, and of its square: sums[0..C), sums[C..2C).
  void (*moments)(const MapRows&, std::int64_t begin, std::int64_t end, const float* shift,
                  double* sums);
  /// Fills map.
  void (*apply)(const MapRows&, std::int64_t begin, std::int64_t end);
  /// Fills pooled and winner from map; begin is even.
  void (*pool)(const MapRows&, std::int64_t begin, std::int64_t end);
  /// g is the gradient of a raw + b. sums[0..C) of g, sums[C..2C) of g (raw - shift). If there is a
  /// mask, mask_gradient [H,W] of the sample, one number per pixel.
  void (*gradient_sums)(const MapRows&, std::int64_t begin, std::int64_t end, const float* shift,
                        double* sums, float* mask_gradient);
  /// Fills raw_gradient = of_g g + of_raw raw + constant, each [C] of the sample.
  void (*gradient)(const MapRows&, std::int64_t begin, std::int64_t end, const float* of_g,
                   const float* of_raw, const float* constant);

  /// log_softmax over the last axis of logits [pixels,K], transposed: log_probs [K,plane], of which
  /// pixels [begin, end) are filled.
  void (*log_softmax)(const void* logits, bool bf16, std::int64_t begin, std::int64_t end,
                      std::int64_t classes, std::int64_t plane, float* log_probs);
  /// Gradient of the logits [pixels,K] from that of log_probs [K,plane].
  void (*log_softmax_gradient)(const float* log_probs, const float* gradient, std::int64_t begin,
                               std::int64_t end, std::int64_t classes, std::int64_t plane,
                               void* logits_gradient, bool bf16);

  /// Pixels [begin, end) of the training loss; see PixelSums.
  void (*pixel_sums)(const PixelSums&, std::int64_t begin, std::int64_t end, double* sums);
  /// Fills gradient [K,plane] for label k. If z > 0 and k > 0, it is exp(log_probs[k]) (of[4k-4] x
  /// + of[4k-3] y + of[4k-2] z + of[4k-1]). If k is the pixel's label, of_label[k] is added.
  void (*pixel_gradient)(const PixelSums&, std::int64_t begin, std::int64_t end, const float* of,
                         const float* of_label, float* gradient);
};

/// The kernels for this processor's instructions.
const MapKernels& Kernels();

}  // namespace volalign::simd

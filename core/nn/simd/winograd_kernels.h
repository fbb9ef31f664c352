#pragma once

#include <cstdint>

namespace volalign::simd {

/// Number of values between the data of one position of a tile and of the next. So the positions do
/// not fall on the same cache lines.
inline constexpr std::int64_t kPositionGap = 64;

/// Maps of a convolution at stride 1 in channels-last order: x [samples,height,width,in], with
/// `padding` pixels of zeros around it, and y [samples,y_height,y_width,out]. `in` and `out` are
/// multiples of 16. Its functions are always inline: the linker would keep one copy of each, which
/// could have instructions that the processor lacks.
struct WinogradMaps {
  std::int64_t kernel = 3;  ///< its height and width: 2 or 3
  std::int64_t padding = 1;
  std::int64_t samples = 0, height = 0, width = 0, in = 0, out = 0;
  const void* x = nullptr;
  const void* weight = nullptr;  ///< of transform_weight
  void* y = nullptr;             ///< or its gradient

  [[gnu::always_inline]] std::int64_t y_height() const { return height + 2 * padding - kernel + 1; }
  [[gnu::always_inline]] std::int64_t y_width() const { return width + 2 * padding - kernel + 1; }
  /// Number of values in a tile. There is a product of matrices for each.
  [[gnu::always_inline]] std::int64_t positions() const { return (kernel + 1) * (kernel + 1); }
  /// Values from one position to the next of the transformed weight, or of the sums for its
  /// gradient. Includes kPositionGap.
  [[gnu::always_inline]] std::int64_t position_stride() const { return in * out + kPositionGap; }
  /// Outputs are computed in tiles of 2x2 pixels, in row-major order, sample by sample.
  [[gnu::always_inline]] std::int64_t tile_rows() const { return (y_height() + 1) / 2; }
  [[gnu::always_inline]] std::int64_t tile_columns() const { return (y_width() + 1) / 2; }
  [[gnu::always_inline]] std::int64_t tiles() const {
    return samples * tile_rows() * tile_columns();
  }
  /// Number of pairs of tiles. The gradient of the weight is a sum over these.
  [[gnu::always_inline]] std::int64_t pairs() const {
    return samples * tile_rows() * ((tile_columns() + 1) / 2);
  }
};

/// The algorithms F(2x2, 3x3) and F(2x2, 2x2) of Lavin and Gray, Fast Algorithms for Convolutional
/// Neural Networks (CVPR 2016). They take 16 multiplications for four outputs and a pair of
/// channels instead of 36, or 9 instead of 16. Values of all maps and of the transformed weight are
/// of the kernels' type; sums are float32.
struct WinogradKernels {
  /// Transforms input channels [begin, end), an even number, to [positions,position_stride], from
  /// `weight` [out,in,kernel,kernel]. If `backward`, from a `weight` [in,out,kernel,kernel], for
  /// the gradient of that convolution's input.
  void (*transform_weight)(const WinogradMaps& maps, const float* weight, bool backward,
                           std::int64_t begin, std::int64_t end, void* result);
  /// Tiles [begin, end) of y. Multiples of 24 are fastest. `scratch` has scratch_bytes(maps) bytes.
  void (*convolve)(const WinogradMaps& maps, std::int64_t begin, std::int64_t end, void* scratch);
  std::int64_t (*scratch_bytes)(const WinogradMaps& maps);

  /// Fills input channels [first, last), multiples of 16, of sums [positions,in,out]
  /// (position_stride) from y's gradient and x in pairs [begin, end), begin < end. `scratch` has
  /// gradient_scratch_bytes(maps, last - first) bytes.
  void (*weight_gradient_sums)(const WinogradMaps& maps, std::int64_t begin, std::int64_t end,
                               std::int64_t first, std::int64_t last, void* scratch, float* sums);
  std::int64_t (*gradient_scratch_bytes)(const WinogradMaps& maps, std::int64_t in);
  /// Input channels [begin, end) of the weight's gradient [out,in,kernel,kernel] from the sums over
  /// all pairs.
  void (*weight_gradient)(const WinogradMaps& maps, const float* sums, std::int64_t begin,
                          std::int64_t end, float* gradient);
};

/// The kernels for float32 or bfloat16 and this processor's instructions. None without AVX2 or
/// AVX512-BF16, or with AMX, whose matrix instructions make the direct convolution faster.
const WinogradKernels* FindWinogradKernels(bool bf16);

}  // namespace volalign::simd

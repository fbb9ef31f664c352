#pragma once

#include <cstdint>

namespace volalign::simd {

/// Maps of a 3x3 convolution at stride 1 with padding 1, in channels-last order: x
/// [samples,height,width,in] and y [samples,height,width,out]. `in` and `out` are multiples of 32.
struct WinogradMaps {
  std::int64_t samples = 0, height = 0, width = 0, in = 0, out = 0;
  const void* x = nullptr;
  const void* weight = nullptr;  ///< of transform_weight
  void* y = nullptr;             ///< or its gradient

  /// Outputs are computed in tiles of 2x2 pixels, in row-major order, sample by sample.
  std::int64_t tile_rows() const { return (height + 1) / 2; }
  std::int64_t tile_columns() const { return (width + 1) / 2; }
  std::int64_t tiles() const { return samples * tile_rows() * tile_columns(); }
};

/// The algorithm F(2x2, 3x3) of Lavin and Gray, Fast Algorithms for Convolutional Neural Networks
/// (CVPR 2016): 16 multiplications for four outputs and a pair of channels instead of 36. Values
/// of all maps and of the transformed weight are of the type that the kernels are for; sums are
/// float32.
struct WinogradKernels {
  /// Input channels [begin, end), an even number of them, of the transformed weight, which has 16
  /// in out values, from `weight` [out,in,3,3]. If `backward`, from a `weight` [in,out,3,3] whose
  /// convolution's gradient of the input is wanted.
  void (*transform_weight)(const float* weight, bool backward, std::int64_t in, std::int64_t out,
                           std::int64_t begin, std::int64_t end, void* result);
  /// Tiles [begin, end) of y. `scratch` has scratch_bytes(in, out) bytes.
  void (*convolve)(const WinogradMaps& maps, std::int64_t begin, std::int64_t end, void* scratch);
  std::int64_t (*scratch_bytes)(std::int64_t in, std::int64_t out);
  /// Tiles that are worked on at a time: begin should be a multiple of it.
  std::int64_t (*block_tiles)(std::int64_t in, std::int64_t out);

  /// The gradient of the weight is summed up over pairs of tiles: their number.
  std::int64_t (*tile_pairs)(const WinogradMaps& maps);
  /// Fills sums [16,in,out] from y's gradient and x in pairs [begin, end), begin < end. `scratch`
  /// has gradient_scratch_bytes(in, out) bytes.
  void (*weight_gradient_sums)(const WinogradMaps& maps, std::int64_t begin, std::int64_t end,
                               void* scratch, float* sums);
  std::int64_t (*gradient_scratch_bytes)(std::int64_t in, std::int64_t out);
  /// Input channels [begin, end) of the weight's gradient [out,in,3,3] from the sums over all
  /// pairs.
  void (*weight_gradient)(const float* sums, std::int64_t in, std::int64_t out, std::int64_t begin,
                          std::int64_t end, float* gradient);
};

/// Those for float32 or bfloat16 and this processor's instructions, or none: no AVX2, no
/// AVX512-BF16, or AMX, whose matrix instructions make the direct convolution the faster one.
const WinogradKernels* FindWinogradKernels(bool bf16);

}  // namespace volalign::simd

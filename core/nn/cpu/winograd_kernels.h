#pragma once

#include <cstdint>

#include "core/base/kernel_sets.h"

namespace volalign::winograd {

/// Numbers of channels are multiples of it.
inline constexpr std::int64_t kChannels = 16;
/// Number of tiles that the kernels compute without a rest.
inline constexpr std::int64_t kTiles = 24;

/// A convolution at stride 1 of maps in channels-last order: x [samples,height,width,in], with
/// `padding` pixels of zeros around it, and y [samples,y_height,y_width,out]. Outputs are computed
/// in tiles of 2x2 pixels, in row-major order, sample by sample. A tile has a value at each of
/// (kernel + 1)^2 positions, and there is a product of matrices for each. The data of one position
/// lie `..._stride` values before those of the next. MapsOf (core/nn/cpu/winograd.h) makes it.
struct Maps {
  std::int64_t kernel, padding, samples, height, width, in, out;
  std::int64_t y_height, y_width, tile_rows, tile_columns, tiles;
  std::int64_t pair_columns, pairs;  ///< pairs of tiles, over which the weight's gradient is a sum
  std::int64_t positions,
      weight_stride;  ///< of the transformed weight and the sums for its gradient
  /// Tiles and pairs that are worked on at a time.
  std::int64_t block_tiles, x_stride, y_stride;
  std::int64_t block_pairs, x_pairs_stride, y_pairs_stride;
  const void* x;
  const void* weight;  ///< of transform_weight
  void* y;             ///< or its gradient
};

/// The algorithms F(2x2, 3x3) and F(2x2, 2x2) of Lavin and Gray, Fast Algorithms for Convolutional
/// Neural Networks (CVPR 2016). They take 16 multiplications for four outputs and a pair of
/// channels instead of 36, or 9 instead of 16. Values of all maps and of the transformed weight are
/// of the kernels' type; sums are float32.
struct Kernels {
  /// Transforms input channels [begin, end), an even number, to [positions,weight_stride], from
  /// `weight` [out,in,kernel,kernel]. If `backward`, from a `weight` [in,out,kernel,kernel], for
  /// the gradient of that convolution's input.
  void (*transform_weight)(const Maps& maps, const float* weight, bool backward, std::int64_t begin,
                           std::int64_t end, void* result);
  /// Tiles [begin, end) of y. Multiples of 24 are fastest. `scratch` has positions (x_stride +
  /// y_stride) numbers of four bytes.
  void (*convolve)(const Maps& maps, std::int64_t begin, std::int64_t end, float* scratch);
  /// Fills sums [positions,in,out] (weight_stride) from y's gradient and x in pairs [begin, end),
  /// begin < end. `scratch` has positions (x_pairs_stride + y_pairs_stride) numbers of four bytes.
  void (*weight_gradient_sums)(const Maps& maps, std::int64_t begin, std::int64_t end,
                               float* scratch, float* sums);
  /// Input channels [begin, end) of the weight's gradient [out,in,kernel,kernel] from the sums over
  /// all pairs.
  void (*weight_gradient)(const Maps& maps, const float* sums, std::int64_t begin, std::int64_t end,
                          float* gradient);
};

}  // namespace volalign::winograd

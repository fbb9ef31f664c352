#pragma once

#include <cstdint>

#include "core/base/kernel_sets.h"

namespace volalign::tiles {

constexpr int kTileWidth = 16, kTileHeight = 8;  // px
constexpr int kTilePixels = kTileWidth * kTileHeight;

/// A linear function x X + y Y + one of the ray (X, Y, 1). It is always evaluated in this order,
/// with each step rounded to float. So its extremes over a tile's rays bound those of the pixels
/// exactly.
struct Linear {
  float x, y, one;
};

/// A convex planar face that is seen from its front.
struct TileFace {
  Linear inverse;     ///< 1 / z of the point where the ray meets the face's plane
  float least, most;  ///< of 1 / z; beyond them it is rounding, for planes seen edge-on
  /// The ray passes through the face if all are >= 0. Unused ones are 0 everywhere.
  Linear edges[6];
  std::uint32_t id;         ///< label << 16 | 1 + face index
  float low_y, high_y;      ///< of the rays through its corners
  std::uint32_t num_edges;  ///< 4, or 6 if the face reaches behind the near plane
};

/// The ranges of the rays of adjacent tiles, one number per tile.
struct TileRanges {
  const float *low_x, *high_x, *low_y, *high_y;
};

/// The rays of a tile: x[row * x_stride + column].
struct TileRays {
  const float *x, *y;
  int x_stride, y_stride;
};

/// The part of the picture for a tile. The pointers are to its first pixel.
struct TileTarget {
  float* depth;
  std::uint8_t* labels;
  std::uint16_t* faces;
  int stride, columns, rows;
};

struct TileKernels {
  const char* name;  ///< of the instruction set
  /// For each of `count` tiles (a multiple of 16): `nearest[i]` is the largest 1 / z that the face
  /// may have there, 0 if no ray meets it. `crossing[i]` has bit k if edge k may cut through it.
  void (*cover)(const TileFace&, const TileRanges&, int count, float* nearest,
                std::int32_t* crossing);
  /// Draws the face (1 / z and id) over a tile's pixels where it is nearer. Tests only the edges in
  /// `crossing`. Returns the least 1 / z of the tile's pixels afterwards.
  float (*paint)(const TileFace&, std::int32_t crossing, const TileRays&, float* inverse,
                 std::uint32_t* ids);
  /// Writes depth, labels and faces of a painted tile.
  void (*finish)(const float* inverse, const std::uint32_t* ids, const TileTarget&);
};

/// All give the same result to the last bit.
const KernelSets<TileKernels>& AllKernels();

}  // namespace volalign::tiles

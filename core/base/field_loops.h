#pragma once

#include <cstdint>

#include "core/base/kernel_sets.h"

namespace volalign {

/// The loops of core/base/noise_fields.h, compiled for several instruction sets. All give the same
/// result to the last bit.
struct FieldLoops {
  /// PixelRandom's uniform numbers of `key` from index `first` on.
  void (*uniform)(std::uint64_t key, std::uint64_t first, int count, float* out);
  /// PixelRandom's normal numbers of `key` from index `first` on.
  void (*normal)(std::uint64_t key, std::uint64_t first, int count, float* out);
  /// Taps of a uniform cubic B-spline with nodes `cell` px apart, scaled so that independent
  /// unit-variance nodes give unit variance. Pixel i uses the nodes from first[i] on, with the
  /// weights [4,count].
  void (*taps)(int count, double cell, double phase, std::int32_t* first, float* weights);
  /// out[i] from a row of nodes by these taps.
  void (*along)(const float* nodes, const std::int32_t* first, const float* weights, int count,
                float* out);
  /// out[i] from four rows, each with its weight.
  void (*across)(const float* const* rows, const float* weights, int count, float* out);
  /// norm (in[i] + side (in[i - 1] + in[i + 1])). At the ends, the missing neighbour is the end
  /// itself.
  void (*smooth)(const float* in, float side, float norm, int count, float* out);
  /// norm (here[i] + side (above[i] + below[i])).
  void (*smooth_across)(const float* above, const float* here, const float* below, float side,
                        float norm, int count, float* out);
};

const KernelSets<FieldLoops>& AllFieldLoops();
/// The best of them.
const FieldLoops& BestFieldLoops();

}  // namespace volalign

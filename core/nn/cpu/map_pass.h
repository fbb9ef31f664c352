#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <vector>

#include "core/nn/cpu/torch_threads.h"
#include "core/nn/simd/map_kernels.h"

namespace volalign {

/// Size of a normalised map.
struct MapSize {
  std::int64_t samples, channels, height, width;
};

/// Size of the map that follows from `raw` (NormalizedMap).
MapSize SizeOfMap(const at::Tensor& raw, bool phases);

/// Number of parts of rows of a sample, for any number of threads. So sums do not depend on
/// threads.
inline constexpr std::int64_t kMapParts = 4;

inline std::int64_t PartBegin(std::int64_t rows, std::int64_t part) {
  return part == kMapParts ? rows : rows * part / kMapParts / 2 * 2;
}

/// Calls f(sample, part, first row, end) in parallel.
template <class F>
void ForMapParts(std::int64_t samples, std::int64_t rows, const F& f) {
  ForEachOnTorchThreads(samples * kMapParts, [&](std::int64_t i) {
    f(i / kMapParts, i % kMapParts, PartBegin(rows, i % kMapParts),
      PartBegin(rows, i % kMapParts + 1));
  });
}

inline bool IsBf16(const at::Tensor& x) { return x.scalar_type() == at::kBFloat16; }

/// z = act(a raw + b) with a, b [S,C]. They follow from the mean [S,C] and the inverse deviation
/// [S,C].
struct MapAffine {
  at::Tensor a, b, mean, inverse;
};

/// Index of the nearest pixel of a mask for each row and column.
struct MaskGrid {
  std::vector<std::int32_t> row, column;
  MaskGrid(const at::Tensor& mask, const MapSize& size);
};

inline char* SampleData(const at::Tensor& x, std::int64_t sample) {
  return static_cast<char*>(x.data_ptr()) +
         sample * x.stride(0) * static_cast<std::int64_t>(x.element_size());
}

/// The arguments of the kernels in a forward or backward pass, for any of its samples.
struct MapPass {
  at::Tensor raw, raw_gradient, map, mask, pooled, winner;
  MapAffine affine;
  MapSize size;
  bool phases = false, relu = true;
  MaskGrid grid;

  simd::MapRows Rows(std::int64_t sample) const;
};

/// A map in channels-last order, not initialised.
at::Tensor EmptyMap(const MapSize& size, std::int64_t channels, at::ScalarType type);

/// `x` if its channels are adjacent and its pixels evenly spaced, as the kernels need (`dense`:
/// without gaps); else such a copy.
at::Tensor EvenlySpaced(const at::Tensor& x, bool dense = false);

/// Sums one number per pixel [S,H,W] over the pixels of each pixel of the mask [S,1,h,w].
at::Tensor SumsOverMask(const at::Tensor& pixels, const at::Tensor& mask, const MaskGrid& grid);

}  // namespace volalign
